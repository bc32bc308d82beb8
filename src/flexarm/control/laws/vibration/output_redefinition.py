"""Output redefinition: control of points between the joints and the tips of the links."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from flexarm.base.errors import public_call
from flexarm.control.contract.base import FloatArray
from flexarm.control.laws.vibration.strain_damping import ModalLaw, StrainDamping
from flexarm.model.drives.around import OutputRedefinitionParameters

#: Vibrations of the arm with free joints have at least this frequency, relative to the highest one.
_RIGID = 1e-5


class OutputRedefinition(OutputRedefinitionParameters, StrainDamping):
    """Joint angles plus a fraction of the bending, as the angles that an inner loop controls.

    The chord of a link connects its joint with the next one, or with the tip. Bending rotates it,
    and ``weight`` times this rotation, from the strains, is added to the joint angle, through a
    low-pass filter. Weights near one return the tip to its reference under loads and payloads that
    the model does not explain; the filter keeps vibration out of this feedback.

    With a cutoff far above the modes, weights between 0 and 1 are the output of Madhavan and Singh
    and of Damaren, and -1 is the reflected tip of Wang and Vidyasagar. `damping_weights` returns
    the range in which small gains damp every mode. Such feedback rarely damps more than the inner
    loop alone: compare by `loop_margins`, and see `IntegralResonantControl` for damping.

    Raises:
        InputError: if a number is out of range, ``modes`` exceeds the number of gauges or bending
            coordinates, the gauges do not distinguish the modes, or ``inner`` plans the bending
            itself.
        EquilibriumError: if the arm has no equilibrium at the posture.
    """

    references: ClassVar[str] = "WangVidyasagar1992 MadhavanSingh1991 Damaren1995"

    def _most_modes(self) -> dict[str, int]:
        return {"gauge": len(self.arm.gauges), "bending coordinate": self.arm.dof - self.arm.joints}

    def _joint_motion(self, shapes: FloatArray, moved: FloatArray) -> FloatArray:
        """Return the rotations (joints, modes) of the chords relative to each other, rad."""
        return self._model.chords(np.asarray(self.posture)) @ shapes[:, self._model.elastic].T

    def _law(self, omega: FloatArray) -> ModalLaw:
        """See `StrainDamping._law`."""
        one = np.eye(len(omega))
        hertz = 0.05 * self.frequency_hz[0] if self.cutoff is None else self.cutoff
        passed, share = 2.0 * np.pi * hertz * one, self.weight * one
        change = share @ passed
        outputs = np.vstack([share, -change]), np.vstack([0.0 * one, change])
        return ModalLaw(-passed, passed, *outputs)

    def _warn_of_growth(self, highest: float) -> None:
        """Do nothing: a loop that does not follow exactly provides the damping."""

    @public_call
    def damping_weights(self) -> tuple[float, float]:
        """Return the range of weights for which small rate gains at any joint damp every mode.

        For one joint this is the range in which the redefined rate is a passive output of the
        torque. Zero is within it. The bending is that which the gauges determine, without a filter.
        """
        from scipy.linalg import eigh

        model = self._linear
        stiffness, shapes = eigh(model.stiffness, model.mass)
        shapes = shapes[:, stiffness > _RIGID**2 * stiffness[-1]]
        turned = shapes[self.arm.joint_index]
        bent = self._driven @ self._observed @ self._strains @ shapes
        # The joint loses energy in a mode if turned * (turned + weight * bent) is positive.
        product = turned * bent
        limits = -(turned[product != 0.0] ** 2) / product[product != 0.0]
        lowest = np.max(limits[limits < 0.0], initial=-np.inf)
        return float(lowest), float(np.min(limits[limits > 0.0], initial=np.inf))
