"""End of a study before all of its samples: a quantile of a metric is known well enough.

The decision follows from the first 64, 128, 256, ... samples alone. It is therefore the same for
all workers, chunks and interruptions, and a store needs no record of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from flexarm.base.errors import AccuracyWarning, warn_caller
from flexarm.cases.studies.execution import RECORDED
from flexarm.integrate.base import FloatArray
from flexarm.model.scenarios.study import SamplePlan

#: Samples of the first decision; each other one has twice as many.
FIRST = 64


class Ending:
    """The number of samples of a study, which may depend on their metrics.

    Args:
        plan: that of the study. count: number of its samples.

    Attributes:
        decisions: numbers of samples after which the study may end; the last one is ``count``.
    """

    def __init__(self, plan: SamplePlan | None, count: int) -> None:
        self._stop = plan.stop if plan is not None else None
        sizes = [FIRST * 2**k for k in range(count.bit_length()) if FIRST * 2**k < count]
        self.decisions: list[int] = [*(sizes if self._stop is not None else []), count]

    def after(self, metrics: FloatArray) -> int | None:
        """Return at how many samples the study ends, None if that takes more metrics.

        Args:
            metrics: those of the first samples, as in `Outcomes`.
        """
        for size in self.decisions:
            if size > len(metrics):
                return None
            if size == self.decisions[-1] or self._width(metrics[:size]) <= self._within:
                return size
        return None

    def lacking(
        self, missing: Callable[[int], list[int]], metrics: Callable[[int], FloatArray]
    ) -> tuple[int, list[int]]:
        """Return how many samples the study needs so far, and their missing chunks.

        Args:
            missing: function from a number of samples to the chunks of these that are missing.
            metrics: function from a number of samples to their metrics.
        """
        size = 0
        for size in self.decisions:
            if chunks := missing(size):
                return size, chunks
            if self.after(metrics(size)) is not None:
                break
        return size, []

    def warn(self, metrics: FloatArray) -> None:
        """Warn if all samples do not suffice."""
        if self._stop is None or len(metrics) < self.decisions[-1]:
            return
        if (width := self._width(metrics)) <= self._within:
            return
        verb = "determine" if np.isfinite(width) else "do not determine"
        precision = f" within {100.0 * width:.2g} %" if np.isfinite(width) else ""
        text = (
            f"{len(metrics)} samples {verb} the {self._stop.quantile:g} quantile of "
            f"{self._stop.metric}{precision}; {100.0 * self._within:g} % were requested. Use more."
        )
        warn_caller(text, AccuracyWarning)

    @property
    def _within(self) -> float:
        return 0.0 if self._stop is None else self._stop.within

    def _width(self, metrics: FloatArray) -> float:
        """Return half the widest interval of the quantile of any drive, plant and motion.

        It is divided by the quantile. Each decision has its part of the probability of an error,
        so that the study ends rightly with the confidence. Runs without a value are left out.
        """
        assert self._stop is not None
        rule, names = self._stop, [metric.name for metric in RECORDED]
        confidence = 1.0 - (1.0 - rule.confidence) / len(self.decisions)
        widths = [0.0]
        values = metrics[..., names.index(rule.metric)].reshape(len(metrics), -1)
        for column in values.T:
            finite = column[np.isfinite(column)]
            low, high = quantile_interval(finite, rule.quantile, confidence)
            size = abs(np.quantile(finite, rule.quantile)) if finite.size else 0.0
            widths.append(0.5 * (high - low) / size if high > low else 0.0)
        return float(np.max(widths))


def quantile_interval(
    values: FloatArray, quantile: float, confidence: float
) -> tuple[float, float]:
    """Return the interval of a quantile from independent samples, for any distribution.

    Its ends are order statistics (David and Nagaraja, Order Statistics, 2003, section 7.1), and
    infinite if there are too few samples.
    """
    from scipy.stats import binom

    tail = 0.5 * (1.0 - confidence)
    low = int(binom.ppf(tail, values.size, quantile)) if values.size else 0
    high = int(binom.ppf(1.0 - tail, values.size, quantile)) + 1 if values.size else 1
    ordered: NDArray[np.float64] = np.sort(values)
    return (
        float(ordered[low - 1]) if low >= 1 else -np.inf,
        float(ordered[high - 1]) if high <= values.size else np.inf,
    )
