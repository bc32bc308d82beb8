"""Cowell's two-step method of order 4 for long vibrations: symmetric, one evaluation a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.integrate.additive_tableau import additive_record
from flexarm.integrate.base import FloatArray, Integrator
from flexarm.integrate.cowell import CowellRecord, advance_cowell
from flexarm.integrate.kennedy_carpenter import ORDER_4
from flexarm.kernels.implicit_step import constants_to_soften
from flexarm.kernels.layout import ArmConstants


@dataclass(frozen=True)
class Cowell4(Integrator):
    """Order 4, fixed step, one evaluation a step, neither gain nor loss of vibration energy.

    Energy is kept of small vibrations; the predicted velocity products of large ones cost a little.
    It does not follow contacts: the formula looks back over four points of a smooth motion.
    Bending and damping are implicit, and damped modes too fast for the step are carried on by the
    trapezoidal rule. After every stop, where the torque is not smooth, three steps are made by
    Kennedy and Carpenter's additive pair of order 4. A motion too fast for the predictions ends it.

    Args:
        step: longest step (s), shortened to meet every stop, and to what the highest frequency and
            the fastest damping of the arm, bent or straight, ask for; None lets ``simulate``
            find one (``flexarm.engine.default_step``).
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
            past=np.zeros((4, 3, *shape)),
            rise=np.zeros(shape),
            stiff=np.zeros(shape),
            missed=np.zeros(3),
            bounds=np.zeros(5),
            softened=constants_to_soften(constants),
        )
