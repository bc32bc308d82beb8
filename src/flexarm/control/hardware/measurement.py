"""Readings of the instruments at one sample time, by name."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.model.wording import nearest

FloatArray = NDArray[np.float64]


class Measurement(Mapping[str, FloatArray]):
    """Readings by name, as ``measurement.joint_angle`` or ``measurement["joint_angle"]``.

    Without ``hardware`` the readings are ``joint_angle`` (joints,) rad and ``joint_rate`` (joints,)
    rad/s, relative, and ``strain`` (gauges,). With it, they are those of its instruments.
    """

    _values: dict[str, FloatArray]

    def __init__(self, **values: FloatArray) -> None:
        # Readings are also stored as attributes, because attribute access is ten times as fast as
        # ``__getattr__``. A reading does not replace a method of the same name.
        mine = vars(self)
        mine.update(values)
        if not _METHODS.isdisjoint(values):
            for name in _METHODS.intersection(values):
                del mine[name]
        mine["_values"] = values

    def __setattr__(self, name: str, value: Any) -> None:
        raise AttributeError(f"a measurement cannot be changed: {name}")

    def __getitem__(self, name: str) -> FloatArray:
        try:
            return self._values[name]
        except KeyError:
            raise _NotMeasured(name, self._values) from None

    def __contains__(self, name: object) -> bool:
        return name in self._values

    def get(self, name: str, default: Any = None) -> Any:
        """Return a reading, or ``default`` if it is not measured."""
        return self._values.get(name, default) if isinstance(name, str) else default

    def __iter__(self) -> Iterator[str]:
        return iter(self._values)

    def __len__(self) -> int:
        return len(self._values)

    def __reduce__(self) -> tuple[object, ...]:
        return _measurement, (self._values,)

    def __getattr__(self, name: str) -> FloatArray:
        if name.startswith("_"):  # copy and pickle look these up before there are values
            raise AttributeError(name)
        try:
            return self._values[name]
        except KeyError:
            raise AttributeError(_not_measured(name, self._values)) from None

    def __repr__(self) -> str:
        return f"Measurement({', '.join(f'{k}={v}' for k, v in self._values.items())})"


def readings_by_name(measured: Sequence[Measurement]) -> dict[str, FloatArray]:
    """Return readings of samples by name, each (samples, ...)."""
    names = measured[0] if measured else ()
    return {name: np.array([item[name] for item in measured]) for name in names}


#: Attribute names that readings do not replace.
_METHODS = frozenset(dir(Measurement)) | {"_values"}


class _NotMeasured(KeyError):
    """Error for a name that is not measured; its message is composed only when it is shown."""

    def __str__(self) -> str:
        name, values = self.args
        return _not_measured(name, values)


def _not_measured(name: str, values: Mapping[str, FloatArray]) -> str:
    hint = nearest(name, values) or _hint(name)
    return f"no instrument measures {name!r}; available readings: {', '.join(values)}. {hint}"


def _hint(name: str) -> str:
    """Return a hint on how to measure a name."""
    if name == "contact_force":
        return "Pass contacts= to simulate; with hardware=, also add an Instrument of this signal."
    if name == "contact_gap":
        return "Pass contacts= to simulate, and hardware= with an Instrument of this signal."
    return "Pass hardware= with an Instrument of this signal or name to simulate."


def _measurement(values: dict[str, FloatArray]) -> Measurement:
    """Create a measurement from its values, for unpickling."""
    return Measurement(**values)
