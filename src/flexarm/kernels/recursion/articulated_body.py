"""Forward dynamics in O(n m): articulated bodies with flexible links.

Theory page "recursion", (R.4) to (R.14). At the tip of a body, the outboard chain is represented
by ``wrench = W A_tip + k`` with a symmetric 3 x 3 ``W``. Each body is eliminated in turn, first
its modes, then its joint.

The modal accelerations are counted relative to those that follow the root's acceleration,
``zeta = eta'' + C A``. In these variables the inertia of the body is block diagonal, and its
residual rigid inertia and residual transfer from root to tip are constants with full precision.
Eliminating ``eta''`` itself would subtract a.a from I, and on a fine mesh these two agree in all
but the last digits.

=============  =================================================================================
symbol         meaning; in the axes of the current body, wrenches and accelerations (x, y, w)
=============  =================================================================================
``W``, ``k``   outboard chain at the tip: six entries xx, xy, yy, xw, yw, ww, and three
``F``          tip acceleration per modal acceleration: rows -G eta, P, dP
``C``          columns -D0 eta, S, a: modal acceleration that follows a root acceleration
``H``, ``h``   residual inertia and bias at the root, then including the outboard chain
``T``          residual transfer T - F C
``N``, ``z``   F F', F times the modal biases
``d``          D0 eta: mass-averaged shortening of the body per modal displacement
``alpha``      translation and, ``beta``, rotation equivalent to the shortening, (L.44)
``kappa``      the inverse of the modal inertia 1 + d d' / m is 1 - kappa d d', (R.44)
``Y``          (1 + W N)^-1 W: the outboard chain in series with the springs of the modes
``g``          Y T: tip force per root acceleration
``U``, ``D``   coefficients of the root acceleration and the joint acceleration in the joint's
               equation
``J``, ``r``   rotary inertia of a motor's rotor, and its gear ratio
``1/Delta``    ``mobility``: 1, or less in an implicit step, (R.27); it multiplies F, C and the
               modal biases once in each product, (R.28)
=============  =================================================================================
"""

from __future__ import annotations

from flexarm.kernels.columns import FLEX_BIAS
from flexarm.kernels.compilation.cache import compiled, merged
from flexarm.kernels.forces.external import apply_loads
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.closures import meet_closures
from flexarm.kernels.recursion.inward import inward
from flexarm.kernels.recursion.outward import outward


@merged
def solve_forward(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write the accelerations of a state under joint torques into ``work.acceleration``.

    ``state`` (2, n, 1 + m); ``torque`` (n,) in N m on the relative joint angles. For a joint that
    is not free, ``torque`` contains its acceleration in rad/s^2 (zero for a fixed joint).
    """
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants, loads, state, work)
    inward(sizes, constants, state, torque, work)
    if len(sizes.closures) > 0:
        meet_closures(sizes, constants, loads, state, work)
    outward(sizes, constants, loads, work)


@compiled
def forward_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Call ``solve_forward`` without inlining it, where speed is less important."""
    solve_forward(sizes, constants, state, torque, loads, work)


@merged
def solve_implicit(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    force: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Write x of (M + added) x = torque + force - bias into ``work.acceleration``, (R.27).

    ``constants`` come from ``implicit_step.add_to_diagonal`` and contain ``added``. ``force``
    (n, 1 + m) acts on the modes; its first column is ignored, because ``torque`` contains the
    forces on joints. The other arguments are those of ``forward_dynamics``.
    """
    link_terms(sizes, constants, state, work)
    apply_loads(sizes, constants, loads, state, work)
    for i in range(len(sizes.bodies)):
        for j in range(len(sizes.modes)):
            work.mode[i, j, FLEX_BIAS] -= force[i, 1 + j]
    inward(sizes, constants, state, torque, work)
    if len(sizes.closures) > 0:
        meet_closures(sizes, constants, loads, state, work)
    outward(sizes, constants, loads, work)


@compiled
def implicit_dynamics(
    sizes: Sizes,
    constants: ArmConstants,
    state: Array,
    force: Array,
    torque: Array,
    loads: Loads,
    work: Workspace,
) -> None:
    """Call ``solve_implicit`` without inlining it, where speed is less important."""
    solve_implicit(sizes, constants, state, force, torque, loads, work)
