"""Constants of a body whose root is at a distance from its joint.

Beams have their constants about their root. A rigid, massless hub of radius r in line with the root
tangent adds r to every distance from the joint. The modes do not change, so no kernel knows the
hub; theory page "link", (L.50). The numbers may be symbols.
"""

from __future__ import annotations

from typing import Any

from flexarm.kernels.layout import ArmConstants


def move_masses(constants: ArmConstants, i: int, radius: Any) -> None:
    """Move the masses of body i outwards by a radius (m), without the hub's own inertia."""
    c = constants
    c.inertia[i] += radius * (2.0 * c.first_moment_x[i] + radius * c.mass[i])
    c.first_moment_x[i] += radius * c.mass[i]
    c.a[i] += radius * c.S[i]
    c.D1[i] += radius * c.D0[i]


def move_root(constants: ArmConstants, i: int, radius: Any) -> None:
    """Move the root of body i outwards by a radius (m), without its length.

    The changes are linear in the constants, so that they apply to derivatives of them, too.
    """
    move_masses(constants, i, radius)
    inertia, tip = constants.residual_inertia[i], constants.residual_tip[i]
    inertia[2] += radius * (2.0 * inertia[1] + radius * inertia[0])
    inertia[1] += radius * inertia[0]
    tip[1] += radius * tip[0]
    tip[3] += radius * tip[2]
