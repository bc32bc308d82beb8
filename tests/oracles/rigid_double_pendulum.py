"""The rigid two-link arm in closed form.

In absolute link angles a1, a2 with b = a1 - a2 Lagrange's equations read

    A a1'' + C cos(b) a2'' + C sin(b) a2'^2 + dU/da1 = tau1 - tau2
    B a2'' + C cos(b) a1'' - C sin(b) a1'^2 + dU/da2 = tau2

    A = m1 L1^2 / 3 + (m2 + me + mp) L1^2 + H1 + Je    (uniform links of mass m1, m2; elbow mass me,
    B = m2 L2^2 / 3 + mp L2^2 + Jp + H2                 payload mp, Jp at the tip; hub inertias H1,
    C = (m2 / 2 + mp) L1 L2                             H2; elbow housing Je on link 1)

With relative joint angles, a = T theta, the mass matrix is T' M T and every force T' times it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

ABSOLUTE = np.array([[1.0, 0.0], [1.0, 1.0]])  # absolute link angles = ABSOLUTE @ relative ones


@dataclass(frozen=True)
class RigidDoublePendulum:
    """Two uniform rigid links; SI units; gravity (gx, gy) in world axes, x right and y up."""

    length: tuple[float, float]
    mass: tuple[float, float]
    hub_inertia: tuple[float, float] = (0.0, 0.0)
    elbow_mass: float = 0.0
    elbow_inertia: float = 0.0
    payload_mass: float = 0.0
    payload_inertia: float = 0.0
    gravity: tuple[float, float] = (0.0, 0.0)

    def _constants(self) -> tuple[float, float, float]:
        (l1, l2), (m1, m2) = self.length, self.mass
        carried = m2 + self.elbow_mass + self.payload_mass
        a = m1 * l1**2 / 3 + carried * l1**2 + self.hub_inertia[0] + self.elbow_inertia
        b = m2 * l2**2 / 3 + self.payload_mass * l2**2 + self.payload_inertia + self.hub_inertia[1]
        return a, b, (m2 / 2 + self.payload_mass) * l1 * l2

    def mass_matrix(self, angles: Any) -> np.ndarray:
        """Return the mass matrix (2, 2) for relative joint angles (2,)."""
        a, b, c = self._constants()
        coupling = c * np.cos(-angles[1])
        return ABSOLUTE.T @ np.array([[a, coupling], [coupling, b]]) @ ABSOLUTE

    def bias_force(self, angles: Any, rates: Any) -> np.ndarray:
        """Return the force (2,) in ``M angle'' + bias = joint torque``: centrifugal, Coriolis,
        gravity."""
        a1, a2 = ABSOLUTE @ angles
        w1, w2 = ABSOLUTE @ rates
        _, _, c = self._constants()
        sine = c * np.sin(a1 - a2)
        (l1, l2), (m1, m2) = self.length, self.mass
        gx, gy = self.gravity
        moment1 = (m1 / 2 + m2 + self.elbow_mass + self.payload_mass) * l1
        moment2 = (m2 / 2 + self.payload_mass) * l2
        force = np.array(
            [
                sine * w2**2 + moment1 * (gx * np.sin(a1) - gy * np.cos(a1)),
                -sine * w1**2 + moment2 * (gx * np.sin(a2) - gy * np.cos(a2)),
            ]
        )
        return ABSOLUTE.T @ force

    def acceleration(self, angles: Any, rates: Any, torque: Any) -> np.ndarray:
        """Return relative joint accelerations (2,) under joint torques (2,) in N m."""
        return np.linalg.solve(self.mass_matrix(angles), torque - self.bias_force(angles, rates))
