"""Samples of an estimator, whose readings may arrive late or seldom."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any, ClassVar

import numpy as np

from flexarm.control.filters.innovation_test import InnovationTest
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import FloatArray, stride_and_delay


@dataclass
class Sample:
    """A sample, until all its readings have arrived.

    Attributes:
        number: of the sample. before: the estimate before its readings, to which late readings
            return. readings: by the place of the instrument. torque: (joints,) N m, after it.
        squared: normalised innovation squared. size: number of its readings.
    """

    number: int
    before: Any = None
    readings: dict[int, FloatArray] = field(default_factory=dict)
    torque: FloatArray = field(default_factory=lambda: np.zeros(0))
    squared: float = 0.0
    size: int = 0

    @property
    def innovation(self) -> float:
        """Normalised innovation squared divided by the number of readings, NaN without any."""
        return self.squared / self.size if self.size else np.nan


class Frames:
    """Frames of the instruments of a filter at its samples.

    Attributes:
        latest: the largest delay, in samples.

    Raises:
        InputError: if the sample time of an instrument is no multiple of ``sample_time`` (s).
    """

    def __init__(self, readings: PredictedReadings, sample_time: float) -> None:
        self._readings = readings
        self._strides = [stride_and_delay(item, sample_time) for item in readings.instruments]
        self.latest = max(late for _, late in self._strides)
        ends = np.cumsum(readings.counts)
        self._parts = [slice(end - n, end) for end, n in zip(ends, readings.counts, strict=True)]
        self._of: dict[tuple[int, ...], PredictedReadings] = {
            tuple(range(len(self._strides))): readings
        }

    def arrived(self, number: int, readings: FloatArray) -> Iterator[tuple[int, int, FloatArray]]:
        """Yield the place of each instrument with a new frame, its delay (samples), its readings.

        Args:
            number: of the present sample. readings: (size,) of all instruments.
        """
        for place, (every, late) in enumerate(self._strides):
            frame = number - late
            if frame >= 0 and frame % every == 0:
                yield place, late, readings[self._parts[place]]

    @property
    def predictions(self) -> Iterable[PredictedReadings]:
        """Predictions of the readings of the samples so far."""
        return self._of.values()

    def of(self, sample: Sample) -> tuple[PredictedReadings, FloatArray]:
        """Return the predictions of the instruments whose readings a sample has, and those."""
        places = tuple(sorted(sample.readings))
        if places not in self._of:
            whole = self._readings
            chosen = [whole.instruments[place] for place in places]
            self._of[places] = PredictedReadings(whole.arm, chosen, whole.biased)
        return self._of[places], np.concatenate([sample.readings[place] for place in places])


class SampledEstimator(ABC):
    """Base of estimators: corrects by the readings of each sample, and predicts the next one.

    Readings with a delay correct the estimate at the time of their frame, from which the later
    samples are computed again.
    """

    #: Attributes that change with the estimate.
    _changing: ClassVar[tuple[str, ...]] = ()
    sample_time: float
    _readings: PredictedReadings
    _torque: FloatArray

    def _restart(self) -> None:
        """Forget all samples."""
        self._test = InnovationTest(type(self).__name__)
        self._frames: Frames | None = None
        self._number = 0
        self._waiting: list[Sample] = []

    @abstractmethod
    def _correct(self, seen: PredictedReadings, readings: FloatArray) -> float:
        """Correct the estimate by readings (k,); return the normalised innovation squared."""

    @abstractmethod
    def _predict(self) -> None:
        """Carry the estimate to the next sample under ``_torque``."""

    def _carry(self, torque: FloatArray) -> None:
        """Carry the estimate to the next sample under a torque (joints,) N m."""
        if self._waiting:
            self._sample().torque = torque
        self._advance(torque)
        self._close(self._number - 1)  # readings may arrive at the present sample

    def _take(self, readings: FloatArray) -> None:
        """Correct by the readings (size,) whose frames are new, from the oldest of these on."""
        if self._frames is None:  # the sample time is now known
            self._frames = Frames(self._readings, self.sample_time)
        again = bool(self._waiting) and self._waiting[-1].number == self._number
        self._latest, age = self._sample(), 0
        for place, late, values in self._frames.arrived(self._number, readings):
            if late < len(self._waiting):
                self._waiting[-1 - late].readings[place] = values
                age = max(age, late)
        samples = self._waiting[-1 - age :]
        if age or again:
            self._return_to(samples[0].before)
        for sample, following in zip_longest(samples, samples[1:]):
            if sample.readings:
                seen, values = self._frames.of(sample)
                sample.squared, sample.size = self._correct(seen, values), values.size
            if following is not None:
                self._number = sample.number
                self._advance(sample.torque)
                following.before = self._present()
        if not self._frames.latest:
            self._close(self._number)

    def _finish(self) -> None:
        """Add all samples to the test, although some may lack readings."""
        assert self._frames is not None
        self._close(self._number + self._frames.latest)

    def _sample(self) -> Sample:
        """Return the present sample, which may wait for readings."""
        if not self._waiting or self._waiting[-1].number != self._number:
            self._waiting.append(Sample(self._number, self._present()))
        return self._waiting[-1]

    def _close(self, number: int) -> None:
        """Add the samples to the test that have all their readings after sample ``number``."""
        latest = self._frames.latest if self._frames is not None else 0
        while self._waiting and self._waiting[0].number <= number - latest:
            sample = self._waiting.pop(0)
            sample.before = None
            if sample.size:
                self._test.add(sample.squared, sample.size)

    def _advance(self, torque: FloatArray) -> None:
        self._torque = torque
        self._number += 1
        self._predict()

    def _present(self) -> Any:
        """Return a copy of the present estimate, if readings may arrive that return to it."""
        if self._frames is None or not self._frames.latest:
            return None
        return self._copied({name: getattr(self, name) for name in ("_torque", *self._changing)})

    def _return_to(self, estimate: Any) -> None:
        for name, value in self._copied(estimate or {}).items():
            setattr(self, name, value)

    def _copied(self, estimate: Any) -> Any:
        """Return a copy of an estimate, with the same predictions of readings."""
        assert self._frames is not None
        return deepcopy(estimate, {id(one): one for one in self._frames.predictions})
