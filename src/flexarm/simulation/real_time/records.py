"""Readings and times of the samples in a result."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.control.hardware.measurement import Measurement, readings_by_name
from flexarm.simulation.calls.result import add_readings
from flexarm.simulation.real_time.clock import SampleTimes

if TYPE_CHECKING:
    import xarray as xr

#: Times of samples: the variable, the attribute of `SampleTimes`, and the meaning.
_TIMES = {
    "sample_start": ("started", "start of the sample on the clock"),
    "sample_late": ("late", "start of the sample after its planned time"),
    "sample_answer": ("answered", "time from the start of the sample to its torque"),
    "sample_busy": ("busy", "time from the start of the sample to the end of its work"),
}


def add_samples(
    run: xr.Dataset, ticks: FloatArray, readings: Sequence[Measurement], times: SampleTimes
) -> xr.Dataset:
    """Return a result with readings and times of its samples, at times ``ticks`` (samples,), s."""
    for name, (attribute, meaning) in _TIMES.items():
        values = np.array(getattr(times, attribute)[: len(ticks)])
        if values.size:
            run[name] = ("tick", values, {"units": "s", "long_name": meaning})
    return add_readings(run, ticks, readings_by_name(readings))
