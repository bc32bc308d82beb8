"""Sampled loop of a linear controller and a linear arm: poles and sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.control.analysis.linear_controller import LinearController
from flexarm.control.analysis.sampled_plant import SampledPlant
from flexarm.control.hardware.measurement import FloatArray

ComplexArray = NDArray[Any]
#: Multipliers below this are zero except for rounding.
_NONE = 1e-9


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """Sampled loop of a linear controller and a linear arm with its motors and instruments.

    Attributes:
        plant, controller: the two parts. The output of the plant is the measurement of the
            controller.
    """

    plant: SampledPlant
    controller: LinearController

    @property
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self.plant.sample_time

    def matrices(self) -> list[FloatArray]:
        """Return the state matrices of (plant, controller) for each sample of a period."""
        A, B, C, D = self.controller
        P, push = self.plant.A, self.plant.B
        return [
            np.block([[now + push @ D @ seen, push @ C], [B @ seen, A]])
            for now, seen in zip(P, self.plant.C, strict=True)
        ]

    def multipliers(self) -> ComplexArray:
        """Return the eigenvalues (k,) of the loop over one sample, largest magnitude first."""
        maps = self.matrices()
        z = np.linalg.eigvals(reduce(lambda done, now: now @ done, maps)).astype(complex)
        z = z ** (1.0 / len(maps))
        found: ComplexArray = z[np.argsort(-np.abs(z))]
        return found

    def poles(self) -> ComplexArray:
        """Return the poles (k,), 1/s, slowest decay first: ``log(z) / sample_time``."""
        z = self.multipliers()
        # Multipliers of zero have no pole. They belong to states that no later sample uses.
        poles: ComplexArray = np.log(z[np.abs(z) > _NONE]) / self.sample_time
        return poles

    def sensitivity(self, z: ComplexArray) -> ComplexArray:
        """Return the input sensitivity (f, joints, joints) at points z (f,) of the complex plane.

        This is the transfer function from a torque added at the motors to the acting torque. It
        requires instruments with the sample time of the controller.
        """
        A, B, C, D = self.controller
        plant = response(self.plant.A[0], self.plant.B, self.plant.C[0], z)
        loop = -(response(A, B, C, z) + D) @ plant
        try:
            found: ComplexArray = np.linalg.inv(np.eye(len(D)) + loop)
        except np.linalg.LinAlgError:  # a pole of the loop at one of the points
            found = np.full(loop.shape, np.inf + 0j)
            regular = np.linalg.matrix_rank(np.eye(len(D)) + loop) == len(D)
            found[regular] = np.linalg.inv((np.eye(len(D)) + loop)[regular])
        return found


def response(A: FloatArray, B: FloatArray, C: FloatArray, z: ComplexArray) -> ComplexArray:
    """Return C (z - A)^-1 B at points z (f,)."""
    if not len(A):
        return np.zeros((len(z), len(C), B.shape[1]), dtype=complex)
    shifted = z[:, None, None] * np.eye(len(A)) - A
    response: ComplexArray = C @ np.linalg.solve(shifted, B.astype(complex))
    return response
