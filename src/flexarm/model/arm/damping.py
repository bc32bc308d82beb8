"""Structural damping of a link, diagonal in the modes of the link."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from flexarm.base.arguments import check_count
from flexarm.base.errors import public_call
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Fraction, NonNegative, OneOrMany
from flexarm.model.wording import Fault


class ModalDamping(Record):
    """Damping ratios of the modes of a link with clamped root and free tip."""

    kind: Literal["modal"] = "modal"
    ratio: OneOrMany[Fraction]
    """Fraction of critical damping: one for all modes, or one for each from the lowest; the last
    one applies to all higher modes."""

    _hints: ClassVar[dict[str, str]] = {
        "ratio": "A ratio is a fraction: 0.01 is one per cent of critical damping."
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("ratio") and given.ratio == ():
            yield Fault(("ratio",), "is empty: give the ratio of at least the lowest mode")

    @public_call
    def ratios(self, modes: int) -> tuple[float, ...]:
        """Return the ratios of the given number of modes, from the lowest.

        Raises:
            InputError: if the number is not a whole one from 0.
        """
        modes = check_count("modes", modes, least=0)
        if not isinstance(self.ratio, Sequence):
            return (self.ratio,) * modes
        missing = modes - len(self.ratio)
        return (*self.ratio[:modes], *(self.ratio[-1],) * missing)


class RayleighDamping(Record):
    """Rayleigh damping of a link: ``mass_coefficient * M + stiffness_coefficient * K``."""

    kind: Literal["rayleigh"] = "rayleigh"
    mass_coefficient: NonNegative = 0.0
    """Factor of the mass matrix (1/s)."""
    stiffness_coefficient: NonNegative = 0.0
    """Factor of the stiffness matrix (s); without mass_coefficient, Kelvin-Voigt damping."""


Damping = Annotated[ModalDamping | RayleighDamping, Field(discriminator="kind")]
