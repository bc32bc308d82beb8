"""Positive position feedback of modal strains around a joint loop."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flexarm.control.contract.base import FloatArray
from flexarm.control.laws.vibration.strain_damping import ModalLaw, StrainDamping
from flexarm.model.drives.around import PositivePositionFeedbackParameters


class PositivePositionFeedback(PositivePositionFeedbackParameters, StrainDamping):
    """Positive position feedback: a resonant filter for each mode moves the joints.

    Each filter has the frequency of its mode and twice the requested damping ratio; its gain makes
    both poles of mode and filter equal, (C.18). The filter attenuates strains above its
    frequency, so higher modes are hardly affected. The reference is moved by the filtered strain
    and its rate.

    The design assumes that the joints follow their reference at the frequency of the mode. The
    inner controller must act on the joint angles of its reference. The arm needs one gauge for
    each mode.

    Raises:
        InputError: if a number is out of range, ``modes`` exceeds the number of joints, gauges or
            bending coordinates, the gauges do not distinguish the modes, or ``inner`` plans the
            bending itself.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        UnstableLoopWarning: if a mode that is not damped, up to the one above the largest possible
            ``modes``, grows around joints that follow exactly.
    """

    references: ClassVar[str] = "GohCaughey1985 FansonCaughey1990"

    def _law(self, omega: FloatArray) -> ModalLaw:
        """See `StrainDamping._law`; (C.18)."""
        count = len(omega)
        one, zero = np.eye(count), np.zeros((count, count))
        ratio = 2.0 * self.damping_ratio
        stiffness, damping = np.diag(omega**2), np.diag(2.0 * ratio * omega)
        return ModalLaw(
            np.block([[zero, one], [-stiffness, -damping]]),
            np.vstack([zero, stiffness]),
            -(ratio**2) * np.eye(2 * count),
            np.zeros((2 * count, count)),
        )
