"""Internal forces at sections of the links.

Theory page "recursion", (R.40) to (R.43). The part of a body between its root and a section is
itself a body, with integrals that end at the section. The same terms with other constants give the
wrench that this part requires. The difference from the joint's wrench passes through the section.
"""

from __future__ import annotations

from flexarm.kernels.columns import WRENCH_W, WRENCH_X, WRENCH_Y
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.compilation.numbers import cos, sin
from flexarm.kernels.forces.external import apply_loads
from flexarm.kernels.kinematics import link_terms
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Stations, Workspace
from flexarm.kernels.recursion.newton_euler import body_wrench


@compiled
def section_forces(
    sizes: Sizes,
    part: ArmConstants,
    stations: Stations,
    state: Array,
    acceleration: Array,
    loads: Loads,
    work: Workspace,
    forces: Array,
) -> None:
    """Fill ``forces`` (k, 3): axial force (N), shear force (N), bending moment (N m).

    They act from the part outboard of a section on the part inboard of it, along and across the
    normal of the section. ``part``: constants of bodies that end at their stations, at most one
    station on each body; ``loads``: the loads inboard of the stations. ``work`` comes from
    ``inverse_dynamics`` of the whole arm with the same ``state`` and ``acceleration`` (n, 1 + m);
    its WRENCH and ROOT_ACCELERATION are read, the rest is overwritten.
    """
    link_terms(sizes, part, state, work)
    apply_loads(sizes, part, loads, state, work)
    for k in range(stations.x.shape[0]):
        i = stations.body[k]
        fx, fy, moment = body_wrench(sizes, part, i, acceleration, 0.0, 0.0, 0.0, work)
        fx = fx - work.body[i, WRENCH_X]
        fy = fy - work.body[i, WRENCH_Y]
        moment = moment - work.body[i, WRENCH_W]
        x = stations.x[k]
        v = 0.0
        phi = 0.0
        for j in range(len(sizes.modes)):
            v += stations.rows[k, j] * state[0, i, 1 + j]
            phi += stations.turns[k, j] * state[0, i, 1 + j]
        for j in range(len(sizes.geometric)):
            for p in range(len(sizes.geometric)):
                x -= 0.5 * state[0, i, 1 + j] * stations.shortening[k, j, p] * state[0, i, 1 + p]
        cosine = cos(phi)
        sine = sin(phi)
        forces[k, 0] = cosine * fx + sine * fy
        forces[k, 1] = cosine * fy - sine * fx
        forces[k, 2] = moment - x * fy + v * fx
