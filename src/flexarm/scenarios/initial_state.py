"""Initial state of a scenario: joint angles, prescribed joints, deflections, holding torque."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.bending import one_warning
from flexarm.histories.loads import interpolated
from flexarm.histories.prescribed import PrescribedAngle, constant
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
from flexarm.motion import Motion, RigidTorque, rigid_torque


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


def start_of(arm: Arm, scenario: Scenario, motion: Motion | PressedMotion | None) -> Start:
    """Return the start of a scenario; a pressed motion starts with links bent by the force.

    Raises:
        EquilibriumError: if an equilibrium is requested and none is found.
    """
    asked = scenario.initial
    angles = np.zeros(arm.joints)
    if asked.joint_angle is not None:
        angles = np.array(asked.joint_angle)
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
        if isinstance(motion, PressedMotion) and not chosen:
            return Start(motion.initial, prescribed)
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


@dataclass(frozen=True, eq=False)
class _Balanced:
    """Rigid torques along a motion, plus a constant for the equilibrium of the flexible arm.

    Rigid torques include neither the loads nor the shift of mass by the sag of the links.
    """

    vectorized: ClassVar[bool] = True

    rigid: RigidTorque
    more: FloatArray  # (joints,)

    @property
    def breaks(self) -> tuple[float, ...]:
        return self.rigid.breaks

    def __call__(self, t: ArrayLike) -> FloatArray:
        return self.rigid(t) + self.more


def feedforward(arm: Arm, motion: Motion | None, start: Start) -> Callable[[Any], Any] | None:
    """Return the rigid torque along a motion, corrected for the equilibrium at the start.

    The correction applies if the start has a holding torque. Without a motion the result is the
    holding torque, or None.
    """
    holding = start.holding
    if motion is None:
        return None if holding is None else partial(constant, holding)
    rigid = rigid_torque(arm, motion)
    if holding is None:
        return rigid
    still = np.zeros(arm.joints)
    known = rigid.rigid_counterpart.inverse_dynamics(motion.joint_angle(0.0), still, still)
    return _Balanced(rigid, holding - known)
