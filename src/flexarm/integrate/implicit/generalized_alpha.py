"""Generalised-alpha method of order 2, with adjustable damping of unresolved vibrations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.base.arguments import check_number
from flexarm.base.errors import public_call
from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.implicit.newmark import NewmarkRecord, advance_newmark
from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.implicit_step import constants_to_soften


@dataclass(frozen=True)
class GeneralizedAlpha(Integrator):
    """Implicit method of order 2 with a fixed step and adjustable damping of fast vibrations.

    Bending is implicit, so stability does not limit the step. The tolerances control how
    accurately the equations of a step are solved, not the error of the step.

    Args:
        step: fixed step (s), shortened to end at every stop; None: ``simulate`` chooses it
            (``flexarm.simulation.run.default_step``).
        spectral_radius: amplification factor per step of a vibration far too fast for the step:
            1 preserves it, 0 removes it in one step.

    Raises:
        InputError: if the spectral radius is not a number from 0 to 1.
    """

    spectral_radius: float = 0.8

    name = "generalized_alpha"
    order = 2
    follows_contacts = False
    reference = ("ChungHulbert1993", "ArnoldBruels2007")
    stepper = staticmethod(advance_newmark)

    @public_call
    def __post_init__(self) -> None:
        rule = "be between 0 and 1"
        check_number("spectral_radius", self.spectral_radius, lambda r: 0.0 <= r <= 1.0, rule)

    def record(self, constants: ArmConstants, state: FloatArray) -> NewmarkRecord:
        """See ``Integrator.record``; the coefficients are those of (I.10)."""
        radius = float(self.spectral_radius)
        alpha_m = (2.0 * radius - 1.0) / (radius + 1.0)
        alpha_f = radius / (radius + 1.0)
        return NewmarkRecord(
            alpha_m=alpha_m,
            alpha_f=alpha_f,
            beta=(radius + 1.0) ** -2,
            gamma=0.5 + alpha_f - alpha_m,
            known=zeros_like(state, *state.shape),
            averaged=zeros_like(state, *state.shape[1:]),
            ends=zeros_like(state, 2, *state.shape),
            change=zeros_like(state, 1, *state.shape),
            one=np.ones((2, 1)),
            softened=constants_to_soften(constants),
        )
