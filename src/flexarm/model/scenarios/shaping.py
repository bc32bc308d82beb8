"""Input shaping and smoothing of motions against residual vibration."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Count, Finite, Listed, OneOrMany, Pair, Positive, plain
from flexarm.model.wording import Fault

Ratio = Annotated[Finite, Field(ge=0, lt=1), BeforeValidator(plain)]
Part = Annotated[Finite, Field(gt=0, lt=1), BeforeValidator(plain)]
_Width = Annotated[Finite, Field(gt=0, le=1), BeforeValidator(plain)]


def _word_or_list(value: Any) -> str:
    return "<list>" if isinstance(plain(value), list | tuple) else "<word>"


_Joint = Literal["locked", "free"]
_JointOrGains = Annotated[
    Annotated[_Joint, Tag("<word>")] | Annotated[Pair, Tag("<list>")],
    Discriminator(_word_or_list),
]
_Joints = Annotated[
    Annotated[_Joint, Tag("<word>")] | Annotated[Listed[_JointOrGains], Tag("<list>")],
    Discriminator(_word_or_list),
]


class ShapingSpec(Record):
    """Input shaping: a sum of delayed copies of the motion whose vibrations cancel.

    The shaped motion takes longer.
    """

    method: Literal["zv", "zvd", "zvdd", "ei", "si"] = "zvd"
    """zv cancels vibration at the design frequencies, zvd also reduces it near them, zvdd in a
    wider range, ei limits it to the tolerance over a wider range, si in the range insensitivity."""
    modes: OneOrMany[Count] = 1
    """Number of lowest modes, or a list of their numbers, from 1."""
    joints: _Joints = "locked"
    """Joints during the vibration: locked, free, or for each joint locked, free or the gains of the
    controller [N m/rad, N m s/rad]."""
    frequency_hz: OneOrMany[Positive] | None = None
    """One or more frequencies, instead of those of the arm's modes along the motion (Hz)."""
    damping_ratio: OneOrMany[Ratio] | None = None
    """One number, or one for each mode; by default that of the modes, or 0 with frequencies."""
    tolerance: Part = 0.05
    """For ei: residual vibration at the design frequency, relative to that of a single impulse; for
    si: largest one in the range."""
    insensitivity: _Width = 0.5
    """For si: width of the range of frequencies, relative to the design frequency."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        for name in ("modes", "frequency_hz", "damping_ratio"):
            if given.has(name) and given.raw(name) == ():
                yield Fault((name,), "is empty")
        if given.absent("frequency_hz"):
            return
        for name, usual in (("modes", 1), ("joints", "locked")):
            if given.has(name) and getattr(given, name) != usual:
                yield Fault((name,), "cannot be combined with frequency_hz")


class SmoothingSpec(Record):
    """Smoothing: the average of each joint angle over a window of the past.

    The smoothed motion takes longer by the window.
    """

    duration: Positive
    """Length of the window (s)."""
    window: Literal["raised_cosine", "moving_average"] = "raised_cosine"
    """Shape of the window."""
