"""External forces and moments on the bodies: theory page "recursion", (R.35) and (R.36).

A dead load keeps its world direction; a follower load rotates with the axes of its body. In the
second-order theory the point of application moves back as the body shortens, and the load does
work on that displacement. This is how axial loads stiffen a link or make it buckle. Contacts act
on their points in the same way.
"""

from __future__ import annotations

from flexarm.kernels.columns import COSINE, FLEX_BIAS, ROOT_BIAS_W, SINE, WORLD_COSINE, WORLD_SINE
from flexarm.kernels.compilation.cache import merged
from flexarm.kernels.forces.contact import touch, world_section
from flexarm.kernels.forces.push import push_at
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace


@merged
def apply_loads(
    sizes: Sizes, constants: ArmConstants, loads: Loads, state: Array, work: Workspace
) -> None:
    """Subtract loads and contact forces from the biases computed by ``link_terms``."""
    if loads.contacts.body.shape[0] > 0:
        touch(sizes, constants, loads.contacts, state, work)
    push_loads(sizes, loads, state, work)


@merged
def push_loads(sizes: Sizes, loads: Loads, state: Array, work: Workspace) -> None:
    """Subtract loads, without contact forces, from the biases computed by ``link_terms``."""
    if loads.body.shape[0] == 0:
        return
    cosine = 1.0
    sine = 0.0
    for i in range(len(sizes.bodies)):
        if len(sizes.tree) > 0:
            cosine, sine = world_section(sizes, i, work)
        turned = cosine * work.body[i, COSINE] - sine * work.body[i, SINE]
        sine = sine * work.body[i, COSINE] + cosine * work.body[i, SINE]
        cosine = turned
        work.body[i, WORLD_COSINE] = cosine
        work.body[i, WORLD_SINE] = sine
    for k in range(loads.body.shape[0]):
        i = loads.body[k]
        # A follower load is not rotated: cosine 1, sine 0.
        cosine = work.body[i, WORLD_COSINE] * (1.0 - loads.follower[k]) + loads.follower[k]
        sine = work.body[i, WORLD_SINE] * (1.0 - loads.follower[k])
        fx = cosine * loads.value[k, 0] + sine * loads.value[k, 1]
        fy = cosine * loads.value[k, 1] - sine * loads.value[k, 0]
        # Weight 0 removes a load together with its moment.
        moment = loads.weight[k] * loads.value[k, 2]
        for j in range(len(sizes.modes)):
            work.mode[i, j, FLEX_BIAS] -= loads.slopes[k, j] * moment
        work.body[i, ROOT_BIAS_W] -= moment
        push_at(
            sizes, loads.rows, loads.shortening, k, i, loads.weight[k], loads.lever[k], fx, fy,
            state, work,
        )  # fmt: skip
