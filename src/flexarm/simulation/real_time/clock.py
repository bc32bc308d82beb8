"""The clock of the computer, and the times of samples."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray

#: Time (s) before an instant at which sleeping ends and the clock is read until the instant is
#: there, because operating systems wake a program late by 50 to 100 us.
_SPIN = 2e-4
_PERCENTILES = (50.0, 99.0, 99.9)


class Clock:
    """Monotonic clock of the computer, s."""

    def now(self) -> float:
        """Return the time, s."""
        return time.perf_counter()

    def wait_until(self, instant: float) -> None:
        """Return at an instant, or at once if it is over."""
        left = instant - self.now() - _SPIN
        if left > 0.0:
            time.sleep(left)
        while self.now() < instant:
            pass


@dataclass
class SampleTimes:
    """Times of the samples of a run, s.

    Attributes:
        started: at which samples started, from the first one.
        late: how long after its planned time a sample started; empty without a plan.
        answered: from the start of a sample to its torque; NaN if the clock starts with it.
        busy: from the start of a sample to the end of its work.
    """

    started: list[float] = field(default_factory=list)
    late: list[float] = field(default_factory=list)
    answered: list[float] = field(default_factory=list)
    busy: list[float] = field(default_factory=list)
    _first: float = 0.0

    def add(self, started: float, answered: float, ended: float, planned: float | None) -> None:
        """Add a sample.

        Args:
            started, answered, ended: on the clock; ``answered`` may be NaN.
            planned: its start, from that of the first sample; None without a plan.
        """
        if not self.started:
            self._first = started
        self.started.append(started - self._first)
        if planned is not None:
            self.late.append(self.started[-1] - planned)
        self.answered.append(answered - started)
        self.busy.append(ended - started)

    def missed(self, sample_time: float) -> int:
        """Return the number of samples whose work ended after the planned time of the next."""
        pairs = zip(self.late, self.busy, strict=False)
        return sum(late + busy > sample_time for late, busy in pairs)

    def table(self) -> str:
        """Return means, percentiles and largest values in microseconds, as lines of text."""
        heads = ["mean", *(f"{p:g} %" for p in _PERCENTILES), "largest"]
        lines = [f"{'µs':<10}" + "".join(f"{head:>11}" for head in heads)]
        rows: dict[str, Sequence[float] | FloatArray] = {
            "period": np.diff(self.started),
            "late": self.late,
            "answer": self.answered,
            "busy": self.busy,
        }
        for name, values in rows.items():
            x = 1e6 * np.asarray(values)
            x = x[np.isfinite(x)]
            if x.size:
                shown = [np.mean(x), *np.percentile(x, _PERCENTILES), np.max(x)]
                lines.append(f"{name:<10}" + "".join(f"{value:>11.1f}" for value in shown))
        return "\n".join(lines)
