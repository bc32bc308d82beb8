"""Cowell's two-step method of order 4 for long vibrations: symmetric, one evaluation per step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.implicit.additive_tableau import additive_record
from flexarm.integrate.implicit.kennedy_carpenter import ORDER_4
from flexarm.integrate.multistep.cowell import CowellRecord, advance_cowell
from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.implicit_step import constants_to_soften


@dataclass(frozen=True)
class Cowell4(Integrator):
    """Symmetric method of order 4 with a fixed step and one evaluation per step.

    It conserves the energy of small vibrations; for large ones, the predicted velocity products
    change it slightly. It does not follow contacts, because the formula uses four points of a
    smooth motion. Bending and damping are implicit, and damped modes too fast for the step are
    integrated by the trapezoidal rule. After every stop, where the torque is not smooth, Kennedy
    and Carpenter's additive pair of order 4 makes three steps. If the motion is too fast for the
    predictions, the run ends.

    Args:
        step: longest step (s), shortened to end at every stop, and as required by the highest
            frequency and the fastest damping of the arm, bent or straight; None: ``simulate``
            chooses it (``flexarm.simulation.run.default_step``).
    """

    name = "cowell_4"
    order = 4
    follows_contacts = False
    reference = ("HairerNorsettWanner1993", "KennedyCarpenter2003")
    stepper = staticmethod(advance_cowell)

    def record(self, constants: ArmConstants, state: FloatArray) -> CowellRecord:
        """See ``Integrator.record``."""
        shape = state.shape[1:]
        return CowellRecord(
            start=additive_record(ORDER_4, constants, state),
            past=zeros_like(state, 4, 3, *shape),
            rise=zeros_like(state, *shape),
            stiff=np.zeros(shape),
            missed=np.zeros(3),
            bounds=np.zeros(5),
            softened=constants_to_soften(constants),
        )
