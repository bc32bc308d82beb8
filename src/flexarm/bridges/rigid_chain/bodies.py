"""Rigid bodies of a chain, as simulators describe them."""

from __future__ import annotations

from typing import NamedTuple

from flexarm.base.errors import InputError, Problem
from flexarm.bridges.rigid_chain.chain import RigidChain


class Body(NamedTuple):
    """A rigid body on a hinge, or welded to the body before. SI units.

    Body axes: origin at the hinge, x along the bar. Inertia is about the centre of mass.
    """

    name: str
    offset: float  # of the hinge along the x axis of the body before
    angle: float  # of a welded body, rad
    length: float
    mass: float
    centre: tuple[float, float]
    inertia: float
    joint: str | None  # name of the hinge; None if it is welded
    stiffness: float
    damping: float
    rest_angle: float


def bodies(chain: RigidChain) -> list[Body]:
    """Return the bodies from the base to the tip: bars, then a payload with an offset.

    A mass at the tip of a bar, such as that of a joint, is part of the body of the bar.

    Raises:
        InputError: if a body has no mass or no inertia, which simulators refuse.
    """
    arm, constants = chain.arm, chain.arm.assembly.constants
    numbers = {place: number for number, place in enumerate(chain.driven, 1)}
    link, bar, found, offset = 0, 0, [], 0.0
    for i in range(arm.assembly.bodies):
        length, tip = float(constants.length[i]), float(constants.tip_mass[i])
        mass = float(constants.mass[i]) + tip
        x = (float(constants.first_moment_x[i]) + tip * length) / mass if mass else 0.0
        y = float(constants.first_moment_y[i]) / mass if mass else 0.0
        about_hinge = float(constants.inertia[i] + constants.tip_inertia[i]) + tip * length**2
        is_bar = i < arm.links
        free = bool(constants.free[i]) and is_bar
        if i in chain.starts:
            link, bar = link + 1, 0
        bar += 1
        name = f"link{link}_{bar}" if is_bar else "payload"
        joint = f"joint{numbers[i]}" if i in numbers else f"bending{link}_{bar - 1}"
        found.append(
            Body(
                name,
                offset,
                0.0 if free else float(constants.joint_angle[i]),
                length,
                mass,
                (x, y),
                about_hinge - mass * (x * x + y * y),
                joint if free else None,
                float(constants.joint_stiffness[i]),
                float(constants.joint_damping[i]),
                float(constants.joint_rest[i]),
            )
        )
        offset = length
    problems = [
        Problem("arm", f"has no mass or no inertia in {body.name}")
        for body in found
        if body.mass <= 0.0 or body.inertia <= 0.0
    ]
    if problems:
        raise InputError(*problems)
    return found
