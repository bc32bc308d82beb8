"""Wave-based control of modal strains around a joint loop."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flexarm.control.contract.base import FloatArray
from flexarm.control.laws.vibration.strain_damping import ModalLaw, StrainDamping
from flexarm.model.drives.around import WaveBasedControlParameters


class WaveBasedControl(WaveBasedControlParameters, StrainDamping):
    """Wave-based control: the joints launch the reference as a wave and absorb what returns.

    Half of the reference is launched, and the returning wave, measured by the strains, is added.
    The moment of the links then moves the joints as a damper would. A damping ratio of 0.5 is the
    matched impedance. Theory page "position control", section 7. Without ``leakage``, as in the
    source, the joints return to the reference after a motion from rest to rest, but constant
    strains that the model does not explain turn them without limit.

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

    references: ClassVar[str] = "OConnor2007"

    def _law(self, omega: FloatArray) -> ModalLaw:
        """See `StrainDamping._law`."""
        one = np.eye(len(omega))
        gain, leak = np.diag(2.0 * self.damping_ratio * omega), np.diag(self.leakage * omega)
        return ModalLaw(-leak, -gain, np.vstack([one, -leak]), np.vstack([0.0 * one, -gain]))
