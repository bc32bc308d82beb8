"""External forces and moments on the bodies: theory page "recursion", (R.35) and (R.36).

A dead load keeps its world direction, a follower load turns with the axes of its body. With the
second-order theory the point of application draws back as the body shortens, and the load works on
that too: this is how axial loads stiffen and buckle.
"""

from __future__ import annotations

from flexarm.kernels.cache import merged
from flexarm.kernels.layout import Array, Loads, Sizes, Workspace


@merged
def apply_loads(sizes: Sizes, loads: Loads, state: Array, work: Workspace) -> None:
    """Take the loads from the biases of roots and modes that ``link_terms`` has left."""
    if loads.body.shape[0] == 0:
        return
    cosine = 1.0
    sine = 0.0
    for i in range(len(sizes.bodies)):
        turned = cosine * work.rotation[i, 0] - sine * work.rotation[i, 1]
        sine = sine * work.rotation[i, 0] + cosine * work.rotation[i, 1]
        cosine = turned
        work.world[i, 0] = cosine
        work.world[i, 1] = sine
    for k in range(loads.body.shape[0]):
        i = loads.body[k]
        # The identity turns a follower load: cosine 1, sine 0.
        cosine = work.world[i, 0] * (1.0 - loads.follower[k]) + loads.follower[k]
        sine = work.world[i, 1] * (1.0 - loads.follower[k])
        fx = cosine * loads.value[k, 0] + sine * loads.value[k, 1]
        fy = cosine * loads.value[k, 1] - sine * loads.value[k, 0]
        # Weight 0 takes a load away, with its moment.
        moment = loads.weight[k] * loads.value[k, 2]
        v = 0.0
        for j in range(len(sizes.modes)):
            v += loads.rows[k, j] * state[0, i, 1 + j]
            work.flex_bias[i, j] -= loads.rows[k, j] * fy + loads.slopes[k, j] * moment
        x = loads.lever[k]
        for j in range(len(sizes.geometric)):
            drawn = 0.0
            for p in range(len(sizes.geometric)):
                drawn += loads.shortening[k, j, p] * state[0, i, 1 + p]
            x -= 0.5 * state[0, i, 1 + j] * drawn
            work.flex_bias[i, j] += drawn * fx
        work.root_bias[i, 0] -= loads.weight[k] * fx
        work.root_bias[i, 1] -= loads.weight[k] * fy
        work.root_bias[i, 2] -= x * fy - v * fx + moment
