"""Initial state of a scenario: joint angles, prescribed joints, deflections, holding torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.cases.scenario.references import Followed
from flexarm.integrate.base import FloatArray
from flexarm.linear import equilibrium
from flexarm.linear.reference_motions.pressed import PressedMotion
from flexarm.model import (
    AccelerationTable,
    FactorTable,
    HeldJoint,
    Load,
    Scenario,
    TabulatedJoint,
)
from flexarm.motion import Motion
from flexarm.simulation.histories.loads import interpolated
from flexarm.simulation.histories.prescribed import PrescribedAngle, constant


@dataclass(frozen=True, eq=False)
class Start:
    """Initial state of a scenario.

    Attributes:
        q: (dof,) coordinates.
        prescribed: motions of joints, by number from 1.
        holding: (joints,) N m in equilibrium, to add to the drive, or None.
    """

    q: FloatArray
    prescribed: dict[int, PrescribedAngle | Motion]
    holding: FloatArray | None = None


def start_of(
    arm: Arm, scenario: Scenario, motion: Motion | PressedMotion | None, followed: Followed
) -> Start:
    """Return the start of a scenario; that of a flexible reference has bent links.

    Raises:
        EquilibriumError: if an equilibrium is requested and none is found.
    """
    asked = scenario.initial
    angles = np.zeros(arm.joints)
    if asked.joint_angle is not None:
        angles = np.array(asked.joint_angle)
    elif followed.initial is not None:
        angles = arm.joint_angles(followed.initial).copy()
    elif motion is not None:
        angles = np.array(motion.joint_angle(0.0))
    prescribed: dict[int, PrescribedAngle | Motion] = {}
    numbers = arm.joint_numbers.tolist()
    for spec in scenario.prescribed:
        place = numbers.index(spec.joint)
        own: PrescribedAngle | Motion
        if isinstance(spec, TabulatedJoint):
            own = PrescribedAngle.table(spec.times, spec.angles, spec.ends)
            angles[place] = own.angle(0.0)
        elif isinstance(spec, HeldJoint):
            own = PrescribedAngle.hold(angles[place])
        else:
            assert isinstance(motion, Motion)  # checked when the file is read
            own = motion
            angles[place] = motion.joint_angle(0.0)[place]
        prescribed[spec.joint] = own
    if not asked.equilibrium:
        chosen = asked.joint_angle is not None or prescribed
        if followed.initial is not None and not chosen:
            return Start(followed.initial, prescribed)
        return Start(arm.rest(angles), prescribed)
    loads = [_load_at_start(load) for load in scenario.loads]
    base, contacts = scenario.base_acceleration, scenario.contacts
    if isinstance(base, AccelerationTable):
        base = interpolated(base).at(np.zeros(1))[0]
    with one_warning():  # the run warns of its states, including this one
        found = equilibrium(arm, angles, loads=loads, base_acceleration=base, contacts=contacts)
    return Start(found.q, prescribed, found.torque if asked.balance else None)


def _load_at_start(load: Load) -> Load:
    """Return a load with its constant value at time zero; at a jump of its factor, after it."""
    if load.factor is None:
        return load
    assert isinstance(load.factor, FactorTable)  # checked when the file is read
    factor = interpolated(load.factor).at(np.zeros(1))
    return load.replace(factor=None).scaled(float(factor[0, 0]))


#: Time (s) before every motion, at which torques are those of the arm at rest.
_LONG_BEFORE = -1e9


@dataclass(frozen=True, eq=False)
class _Balanced:
    """Torques along a motion, plus a constant for the equilibrium of the arm at the start.

    The torques do not include the loads, and rigid torques not the sag of the links.
    """

    vectorized: ClassVar[bool] = True

    torque: Any
    more: FloatArray  # (joints,)

    @property
    def breaks(self) -> tuple[float, ...]:
        return tuple(getattr(self.torque, "breaks", ()))

    def __call__(self, t: ArrayLike) -> FloatArray:
        return np.asarray(self.torque(t)) + self.more


def with_holding(torque: Callable[[Any], Any] | None, start: Start) -> Callable[[Any], Any] | None:
    """Return a torque along a motion, corrected for the equilibrium at the start.

    The correction applies if the start has a holding torque. Without a torque the result is the
    holding torque, or None.
    """
    holding = start.holding
    if torque is None:
        return None if holding is None else partial(constant, holding)
    if holding is None:
        return torque
    return _Balanced(torque, holding - np.asarray(torque(_LONG_BEFORE)))
