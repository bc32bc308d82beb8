"""Integral resonant control of modal strains around a joint loop."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flexarm.control.contract.base import FloatArray
from flexarm.control.laws.vibration.strain_damping import ModalLaw, StrainDamping
from flexarm.model.drives.around import IntegralResonantControlParameters


class IntegralResonantControl(IntegralResonantControlParameters, StrainDamping):
    """Integral resonant control: the integral of the strain of each mode moves the joints.

    A feedthrough from the motion of the joints to the integrated signal places a zero below each
    mode, at the frequency of the mode divided by 1 + 2 ``damping_ratio``. The gain is that of the
    largest damping, (C.19). The feedthrough returns the joints to the reference, so
    constant strains that the model does not explain do not accumulate.

    The design assumes that the joints follow their reference at the frequency of the mode. The
    inner controller must act on the joint angles of its reference. The arm needs one gauge for
    each mode. Around one link the law damps higher modes as well. With several links modes
    that are not damped can grow: compare ``modes`` up to the number of joints by `loop_margins`.

    Raises:
        InputError: if a number is out of range, ``modes`` exceeds the number of joints, gauges or
            bending coordinates, the gauges do not distinguish the modes, or ``inner`` plans the
            bending itself.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        UnstableLoopWarning: if a mode that is not damped, up to the one above the largest possible
            ``modes``, grows around joints that follow exactly.
    """

    references: ClassVar[str] = "AphaleEtAl2007 PereiraEtAl2011 NamavarEtAl2014"

    def _law(self, omega: FloatArray) -> ModalLaw:
        """See `StrainDamping._law`; (C.19)."""
        count = len(omega)
        ratio = 1.0 + 2.0 * self.damping_ratio  # of the frequencies of pole and zero
        through = 1.0 / (ratio**2 - 1.0)
        gain = np.diag(omega * np.sqrt(ratio) / (1.0 + through))
        one = np.eye(count)
        return ModalLaw(
            -through * gain,
            -gain,
            np.vstack([one, -through * gain]),
            np.vstack([0.0 * one, -gain]),
        )
