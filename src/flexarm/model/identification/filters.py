"""Filters of measured channels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Flag, Number, Positive
from flexarm.model.wording import Fault

Order = Annotated[int, Field(strict=True, ge=1, le=2)]


class Filter(Record, kw_only=False):
    """One filter of a measured channel; the simulated channel passes through the same filter.

    Filters of first order are ``1 / (1 + s / w)`` and ``(s / w) / (1 + s / w)``, those of second
    order ``w^2 / (s^2 + 2 d w s + w^2)`` and ``s^2 / (s^2 + 2 d w s + w^2)``, with ``w = 2 pi
    cutoff`` and ``d = damping``. They are discretised by Tustin's rule and start in the steady
    state of the first sample.
    """

    kind: Literal["low_pass", "high_pass", "remove_mean", "gain"]
    """low_pass, high_pass, remove_mean or gain."""
    cutoff: Positive | None = None
    """Cutoff frequency of low_pass and high_pass (Hz)."""
    order: Order = 1
    """Order of low_pass and high_pass, 1 or 2."""
    damping: Positive = 0.7071067811865476
    """Damping ratio of a filter of second order."""
    factor: Number | None = None
    """Factor of gain."""
    recorded: Flag = False
    """Whether the record contains the effect of the filter already, so that only the simulated
    channel is filtered."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("kind"):
            return
        passes = given.kind in ("low_pass", "high_pass")
        if passes and given.absent("cutoff"):
            yield Fault(("cutoff",), f"is required for {given.kind}")
        if given.kind == "gain" and given.absent("factor"):
            yield Fault(("factor",), "is required for gain")
        for name, fits in (("cutoff", passes), ("factor", given.kind == "gain")):
            if not fits and not given.absent(name):
                yield Fault((name,), f"is not supported for {given.kind}", shown(given.raw(name)))
