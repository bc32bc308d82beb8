"""Numbers that a batch computes from the channels of each run instead of storing them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from flexarm.base.arguments import check_choice, check_mapping, check_nonnegative, check_positive
from flexarm.base.errors import InputError, Problem, check_array, nearest, public_call, shown
from flexarm.integrate.base import FloatArray
from flexarm.simulation.run.channels import CHANNELS

#: Channels of one run (samples, ...) by name.
Channels = Mapping[str, FloatArray]


class _Kind(NamedTuple):
    """A built-in reduction."""

    #: function of times (samples,), values (samples, ...) and the band
    reduce: Callable[[FloatArray, FloatArray, float], Any]
    about: str | None  # value to subtract first: "mean", "last" or None
    length: bool  # whether vectors along ``axis`` count by their length
    meaning: str  # for the label of the variable


def _settling(times: FloatArray, values: FloatArray, band: float) -> Any:
    """Return the time from the first sample until the values stay within the band."""
    outside = np.abs(values) > band
    last = len(times) - 1 - np.argmax(outside[::-1], axis=0)  # last sample outside
    settled = times[np.minimum(last + 1, len(times) - 1)]
    return np.where(outside.any(axis=0), settled, times[0]) - times[0]


#: Built-in reductions by name.
KINDS: dict[str, _Kind] = {
    "peak": _Kind(lambda t, x, band: np.abs(x).max(axis=0), None, True, "largest magnitude of"),
    "rms": _Kind(
        lambda t, x, band: np.sqrt(np.mean(x**2, axis=0)), None, True, "root mean square of"
    ),
    "mean": _Kind(lambda t, x, band: x.mean(axis=0), None, False, "mean of"),
    "final": _Kind(lambda t, x, band: x[-1], None, False, "last value of"),
    "residual": _Kind(
        lambda t, x, band: np.abs(x).max(axis=0), "mean", True, "largest distance from the mean of"
    ),
    "settling": _Kind(_settling, "last", True, "settling time of"),
}


@dataclass(frozen=True)
class Reduction:
    """A number, or one for each joint or link, computed from the channels of a run.

    Args:
        kind: "peak", largest magnitude; "rms", root mean square; "mean"; "final", last value;
            "residual", largest distance from the mean; "settling", time (s) from ``after`` until
            the channel stays within ``band`` of its last value. Or a function of the times
            (samples,), s, and of the values (samples, ...) of each channel, that returns a number.
        channel: name of a channel of results; a function may have a list of them.
        after: time (s) from which samples count, within the duration; NaN if an event ends the run
            before it.
        band: of "settling", in the unit of the channel.

    Raises:
        InputError: if the kind or a channel is not known, a time is negative, or ``band`` is
            missing or not positive.

    Except for "mean" and "final", vectors along ``axis``, such as the tip, count by their length;
    "residual" and "settling" use the length of the difference.
    """

    kind: str | Callable[..., Any]
    channel: str | Sequence[str]
    after: float = 0.0
    band: float | None = None

    @public_call
    def __post_init__(self) -> None:
        if not callable(self.kind):
            check_choice("kind", self.kind, KINDS)
        names = self.channels
        if not names or (not callable(self.kind) and not isinstance(self.channel, str)):
            rule = "be the name of a channel" + ", or a list of them" * callable(self.kind)
            raise InputError(Problem("channel", rule, shown(self.channel)))
        for name in names:
            check_channel("channel", name)
        check_nonnegative("after", self.after)
        if (self.kind == "settling") != (self.band is not None):
            rule = "is required by settling" if self.band is None else "applies to settling only"
            raise InputError(Problem("band", rule))
        if self.band is not None:
            check_positive("band", self.band)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels."""
        if isinstance(self.channel, str):
            return (self.channel,)
        return tuple(self.channel) if isinstance(self.channel, list | tuple) else ()

    @property
    def dims(self) -> tuple[str, ...]:
        """Dimensions of the value, besides ``run``."""
        if callable(self.kind):
            return ()
        dims = CHANNELS[self.channels[0]].dims
        if KINDS[self.kind].length:
            return tuple(dim for dim in dims if dim != "axis")
        return dims

    @property
    def labels(self) -> dict[str, str]:
        """Unit and meaning of the value; none for a function."""
        if callable(self.kind):
            return {}
        channel = CHANNELS[self.channels[0]]
        unit = "s" if self.kind == "settling" else channel.unit
        return {"units": unit, "long_name": f"{KINDS[self.kind].meaning} {channel.name}"}


def reduced(item: Reduction, times: FloatArray, channels: Channels) -> FloatArray:
    """Return the value of a reduction for a run with samples at ``times`` (samples,), s."""
    first = int(np.searchsorted(times, item.after))
    values = [channels[name][first:] for name in item.channels]
    times = times[first:]
    if callable(item.kind):
        value = item.kind(times, *values)
        return check_array("the value of the function", value, ())
    dims = CHANNELS[item.channels[0]].dims
    kind, one = KINDS[item.kind], values[0]
    if not times.size:
        kept = [n for n, dim in zip(one.shape[1:], dims, strict=True) if dim in item.dims]
        return np.full(kept, np.nan)
    if kind.about is not None:
        one = one - (one.mean(axis=0) if kind.about == "mean" else one[-1])
    if kind.length and "axis" in dims:
        one = np.sqrt(np.sum(one**2, axis=1 + dims.index("axis")))
    return np.asarray(kind.reduce(times, one, item.band or 0.0))


def check_channel(name: str, channel: object) -> str:
    """Return the name of a channel of results."""
    if isinstance(channel, str) and channel in CHANNELS:
        return channel
    rule = "be the name of a channel of results"
    raise InputError(Problem(name, rule, shown(channel), nearest(channel, CHANNELS)))


def check_reductions(given: object, taken: Sequence[str]) -> dict[str, Reduction]:
    """Return reductions by the names of their variables; ``taken``: names of other variables."""
    if given is None:
        return {}
    found = dict(check_mapping("reductions", given, "names and Reduction objects"))
    problems = []
    for name, item in found.items():
        if not isinstance(name, str) or not name:
            problems.append(Problem("reductions", "have names that are text", shown(name)))
        elif name in taken:
            problems.append(Problem("reductions", "have names of their own", shown(name)))
        elif not isinstance(item, Reduction):
            place = f"reductions[{name!r}]"
            problems.append(Problem(place, "be a Reduction", shown(item)))
    if problems:
        raise InputError(*problems)
    return found


def check_samples(reductions: Mapping[str, Reduction], end: float) -> None:
    """Raise if a reduction would have no samples; ``end``: time of the last sample, s."""
    problems = [
        Problem(f"reductions[{name!r}].after", f"be at most {end:g} s, the end", shown(item.after))
        for name, item in reductions.items()
        if item.after > end
    ]
    if problems:
        raise InputError(*problems)
