"""Instruments and motors of a scenario as arguments of ``simulate``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from flexarm.hardware.hardware import Hardware, Motors
from flexarm.hardware.instruments import Instrument
from flexarm.linear.signals import Sensor
from flexarm.model import HardwareSpec
from flexarm.model.hardware import POINT_SIGNALS, InstrumentSpec, MotorsSpec


def hardware_of(spec: HardwareSpec | None) -> Hardware | None:
    """Return the hardware that a file describes, or None."""
    if spec is None:
        return None
    instruments = None if spec.instruments is None else instruments_of(spec.instruments)
    return Hardware(instruments, _motors(spec.motors), spec.seed)


def instruments_of(specs: Sequence[InstrumentSpec]) -> list[Instrument]:
    """Return the instruments that a file describes."""
    return [_instrument(item) for item in specs]


def _instrument(spec: InstrumentSpec) -> Instrument:
    signal: str | Sensor = spec.signal
    if spec.signal in POINT_SIGNALS and spec.link is not None:
        signal = Sensor(spec.signal, spec.link, spec.station, spec.frame)
    return Instrument(
        signal=signal,
        name=spec.name,
        resolution=spec.resolution,
        noise=spec.noise,
        bias=spec.bias,
        limit=math.inf if spec.limit is None else spec.limit,
        delay=spec.delay,
        sample_time=spec.sample_time,
        rate_cutoff=spec.rate_cutoff,
        rate_name=spec.rate_name,
    )


def _motors(spec: MotorsSpec | None) -> Motors | None:
    if spec is None:
        return None
    given = {name: getattr(spec, name) for name in MotorsSpec.model_fields}
    told: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return Motors(**told)
