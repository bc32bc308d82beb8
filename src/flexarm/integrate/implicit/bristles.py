"""Implicit stages with bristles, whose equation is linear in their deflection and in the rate.

Theory page "integration", (I.17). In ``s' = root rate - decay s`` and in the torque of the
bristles, deflection and rate are those of the implicit state of a stage, the decay is that of the
explicit one. The deflection is eliminated, and what remains is a damping of the joint: no
iteration.
"""

from __future__ import annotations

from flexarm.integrate.base import System
from flexarm.kernels.columns import (
    BRISTLE_ROOT,
    FREE,
    JOINT_ADDED,
    JOINT_DAMPING,
    JOINT_DRAG,
    JOINT_STIFFNESS,
)
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.forces.joint_law import (
    bristle_decay,
    bristle_pull,
    bristle_slope,
    friction_slope,
)
from flexarm.kernels.layout import ArmConstants, Array


@merged
def hold_bristles(
    system: System, softened: ArmConstants, state: Array, smooth: Array, known: Array,
    torque: Array, hold: float,
) -> None:  # fmt: skip
    """Add the damping by bristles to ``softened``, and their known torque to ``torque`` (n,).

    ``additive.shift_forces`` then replaces the rate, as for every damping.

    Args:
        state, smooth, known: (2, n, 1 + m) at the start of the step, explicit state of the stage,
            and its implicit state without its own slope.
        hold: weight of this slope, s.
    """
    c = system.constants
    b = len(system.sizes.modes)  # column of the bristles
    for i in range(len(system.sizes.bodies)):
        rate = smooth[1, i, 0]
        decay = bristle_decay(c, i, rate)
        drag = friction_slope(system.sizes, c, i, state[1, i, 0])
        drag += bristle_slope(c, i, decay, hold)
        softened.body[i, JOINT_DRAG] = drag
        softened.body[i, JOINT_ADDED] = c.body[i, JOINT_ADDED]  # of a sticking joint
        softened.body[i, JOINT_ADDED] += hold * (c.body[i, JOINT_DAMPING] + drag)
        softened.body[i, JOINT_ADDED] += hold * hold * c.body[i, JOINT_STIFFNESS]
        s = (known[1, i, b] + hold * c.body[i, BRISTLE_ROOT] * rate) / (1.0 + hold * decay)
        torque[i] += c.body[i, FREE] * bristle_pull(c, i, decay) * (smooth[1, i, b] - s)


@merged
def bend_bristles(system: System, smooth: Array, known: Array, hold: float) -> None:
    """Replace the slopes of bristles by those of their implicit deflection, after a solution.

    Arguments as in ``hold_bristles``.
    """
    c = system.constants
    b = len(system.sizes.modes)
    for i in range(len(system.sizes.bodies)):
        decay = bristle_decay(c, i, smooth[1, i, 0])
        rate = known[1, i, 0] + hold * system.work.acceleration[i, 0]
        driven = c.body[i, BRISTLE_ROOT] * rate
        system.work.acceleration[i, b] = (driven - decay * known[1, i, b]) / (1.0 + hold * decay)
