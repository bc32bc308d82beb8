"""Planned inputs of laws over symbols, where exported code computes them from the reference."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.bridges.symbolic.casadi_model import casadi_model
from flexarm.bridges.symbolic.kernel_calls import symbolic
from flexarm.bridges.symbolic.scalars import objects, plain
from flexarm.bridges.symbolic.symbol_array import symbol_array
from flexarm.control.contract.base import Arrays
from flexarm.control.design.nominal import Nominal
from flexarm.control.design.surface_plan import SurfaceMotion, SurfacePlan
from flexarm.control.design.task_plan import TaskPlan
from flexarm.control.design.task_space import TaskSpace, TaskState
from flexarm.control.laws.force.task_controller import TaskController
from flexarm.control.laws.vibration.strain_damping import StrainDamping
from flexarm.kernels.controller_terms.task_dynamics import tip_torque

#: Coefficients of friction of the two references, where they are not given.
FRICTION = {"reference_friction": np.zeros(1), "rougher_friction": np.ones(1)}
_Array = Callable[..., Any]


def plan_over_symbols(law: Any, arm: Arm, array: _Array) -> Arrays | None:
    """Return the planned inputs of a symbolic law from the reference; None if they are symbols.

    Args:
        law: law of symbols; its plans are replaced at the first call.
        arm: the arm.
        array: function that returns an array of symbols for a name and a shape.
    """
    parts = list(around(law))
    presses = any(isinstance(part, TaskController) for part in parts)
    if not presses and not any(isinstance(part, StrainDamping) for part in parts):
        return None
    reference: Any = (PressedInputs if presses else ReferenceInputs)(array, arm.joints)
    for part in parts:
        if isinstance(part, TaskController) and not isinstance(part._task, SymbolicTask):
            part._task = SymbolicTask(part.arm)
            _plan_task(part, array)
        if isinstance(part, StrainDamping) and not isinstance(part._nominal, StaticBending):
            correction = array("strain_correction", len(arm.gauges))
            part._nominal = StaticBending(part._nominal, correction)  # type: ignore[assignment]
    planned = dict(law.planned(0.0, reference))
    if "feedforward" in planned:
        planned["feedforward"] = array("feedforward", arm.joints)
    return planned


def around(controller: Any) -> Iterator[Any]:
    """Iterate over a controller, the controller inside it, and so on."""
    while controller is not None:
        yield controller
        controller = getattr(controller, "inner", None)


class ReferenceInputs:
    """Reference whose values are symbols, at every time."""

    def __init__(self, array: _Array, joints: int, prefix: str = "reference") -> None:
        self._angle = array(f"{prefix}_angle", joints)
        self._rate = array(f"{prefix}_rate", joints)
        self._acceleration = array(f"{prefix}_acceleration", joints)

    def joint_angle(self, t: float) -> Any:
        return self._angle

    def joint_rate(self, t: float) -> Any:
        return self._rate

    def joint_acceleration(self, t: float) -> Any:
        return self._acceleration


class PressedInputs(ReferenceInputs):
    """Reference that presses, such as `PressedMotion`, whose values are symbols at every time.

    ``rougher`` has the same force, and other joint motions for more friction.
    """

    def __init__(self, array: _Array, joints: int, prefix: str = "reference") -> None:
        super().__init__(array, joints, prefix)
        self._array, self._joints = array, joints
        self._force = array("reference_force", 1)[0]
        self._normal = array("reference_normal", 2)
        self._pressing = array(f"{prefix}_pressing", joints)
        self.friction = array(f"{prefix}_friction", 1)[0]

    @property
    def rougher(self) -> PressedInputs:
        return PressedInputs(self._array, self._joints, "rougher")

    def contact_force(self, t: float) -> Any:
        return self._force

    def normal(self, t: float) -> Any:
        return self._normal

    def pressing_torque(self, t: float) -> Any:
        return self._pressing


class StaticBending:
    """Nominal motion of `StrainDamping`, computed at every sample instead of in advance.

    Args:
        planned: the nominal motion in advance.
        correction: symbols of ``StrainDamping.strain_correction``.
    """

    def __init__(self, planned: Any, correction: Any) -> None:
        self._planned, self._correction = planned, correction

    def at(self, t: float, reference: Any) -> Nominal:
        parts = reference.joint_angle, reference.joint_rate, reference.joint_acceleration
        found = self._planned.along(*(part(t)[None] for part in parts))
        static = Nominal(*(rows[0] for rows in found))
        return static._replace(shown=static.shown + self._correction)


class SymbolicTask(TaskSpace):
    """Kinematics and dynamics of the rigid model at its tip, over symbols.

    The kernels of `TaskSpace` differentiate by complex numbers; here CasADi differentiates.
    """

    def __init__(self, arm: Arm) -> None:
        model, self.joints = casadi_model(arm.rigid()), arm.joints
        q, qd = casadi.SX.sym("q", self.joints), casadi.SX.sym("qd", self.joints)
        none = casadi.SX(0, 1)
        velocity = model.tip_velocity(q, qd, none)[:2]
        parts = {
            "motion": casadi.horzcat(
                model.tip(q, none)[:2], velocity, casadi.jtimes(velocity, q, qd)
            ).T,
            "jacobian": casadi.jacobian(velocity, qd),
            "mass": model.mass_matrix(q, none),
            "bias": model.bias_force(q, qd, none),
        }
        self._function = casadi.Function("task", [q, qd], list(parts.values()))

    def at(self, angle: Any, rate: Any) -> TaskState:
        """See ``TaskSpace.at``."""
        given = (casadi.vertcat(*map(plain, one)) for one in (angle, rate))
        motion, jacobian, mass, bias = map(_entries, self._function(*given))
        return TaskState(motion, jacobian, mass, bias[:, 0])

    def torque(
        self, state: TaskState, acceleration: Any, push: Any, posture: Any, added: Any
    ) -> Any:
        """See ``TaskSpace.torque``."""
        torque = symbol_array(np.zeros(self.joints))
        symbolic(tip_torque)(*state, posture, *acceleration, *push, added, torque)
        return torque


def _entries(matrix: Any) -> Any:
    """Return a matrix of CasADi as an array of symbols."""
    entries = objects(casadi.vertsplit(casadi.vec(casadi.densify(matrix.T))), casadi)
    return symbol_array(entries.reshape(matrix.shape))


class _Plan(TaskPlan):
    """Requested motion of the tip, from the rigid model at the reference."""

    def __init__(self, controller: Any) -> None:
        super().__init__(controller.arm, controller.sample_time)
        self._task = controller._task

    def row(self, t: float, reference: Any) -> Any:
        angle, rate = reference.joint_angle(t), reference.joint_rate(t)
        acceleration = reference.joint_acceleration(t)
        position, velocity, drift = (state := self._task.at(angle, rate)).motion
        numbers = (position, velocity, drift + state.jacobian @ acceleration)
        force = symbol_array([reference.contact_force(t)])
        motion = (angle, rate, acceleration, reference.pressing_torque(t))
        return symbol_array(np.concatenate([*numbers, force, reference.normal(t), *motion]))


class _SurfacePlan(SurfacePlan):
    """Requested motion along a surface, from symbols."""

    def __init__(self, array: _Array) -> None:
        speed, force_rate = array("path_speed", 1), array("reference_force_rate", 1)
        self._motion_of = SurfaceMotion(*array("path_position", 2), *speed, *force_rate)

    def along(self, t: float, reference: Any) -> SurfaceMotion:
        return self._motion_of


def _plan_task(controller: Any, array: _Array) -> None:
    """Replace the requested motion of a controller by symbols."""
    controller._plan = _Plan(controller)
    if hasattr(controller, "_surface"):
        controller._rougher, controller._surface = controller._plan, _SurfacePlan(array)
