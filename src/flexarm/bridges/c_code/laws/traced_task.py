"""Controllers of the tip over symbols: their rigid model, and the requested motion and force."""

from __future__ import annotations

from typing import Any

import casadi
import numpy as np

from flexarm.arm.arm import Arm
from flexarm.bridges.c_code.laws.traced_inputs import Inputs, ReferenceInputs
from flexarm.bridges.symbolic.casadi_model import casadi_model
from flexarm.bridges.symbolic.kernel_calls import symbolic
from flexarm.bridges.symbolic.scalars import objects, plain
from flexarm.bridges.symbolic.symbol_array import symbol_array
from flexarm.control.design.surface_plan import SurfaceMotion, SurfacePlan
from flexarm.control.design.task_plan import TaskPlan
from flexarm.control.design.task_space import TaskSpace, TaskState
from flexarm.control.laws import AdaptiveForce
from flexarm.kernels.controller_terms.task_dynamics import tip_torque

#: Coefficients of friction of the two references, where they are not given.
FRICTION = {"reference_friction": np.zeros(1), "rougher_friction": np.ones(1)}


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

    def __deepcopy__(self, memo: dict[int, Any]) -> SymbolicTask:
        return self  # it does not change

    def at(self, angle: Any, rate: Any) -> TaskState:
        """See ``TaskSpace.at``."""
        given = (casadi.vertcat(*map(plain, one)) for one in (angle, rate))
        motion, jacobian, mass, bias = map(_array, self._function(*given))
        return TaskState(motion, jacobian, mass, bias[:, 0])

    def torque(
        self, state: TaskState, acceleration: Any, push: Any, posture: Any, added: Any
    ) -> Any:
        """See ``TaskSpace.torque``."""
        torque = symbol_array(np.zeros(self.joints))
        symbolic(tip_torque)(*state, posture, *acceleration, *push, added, torque)
        return torque


def _array(matrix: Any) -> Any:
    """Return a matrix of CasADi as an array of symbols."""
    entries = objects(casadi.vertsplit(casadi.vec(casadi.densify(matrix.T))), casadi)
    return symbol_array(entries.reshape(matrix.shape))


class PressedInputs(ReferenceInputs):
    """Reference that presses, such as `PressedMotion`, whose values are symbols at every time.

    ``rougher`` has the same force, and other joint motions for more friction.
    """

    def __init__(self, inputs: Inputs, joints: int, prefix: str = "reference") -> None:
        super().__init__(inputs, joints, prefix)
        self._inputs, self._joints = inputs, joints
        self._force = inputs.array("reference_force", 1)[0]
        self._normal = inputs.array("reference_normal", 2)
        self._pressing = inputs.array(f"{prefix}_pressing", joints)
        self.friction = inputs.array(f"{prefix}_friction", 1)[0]

    @property
    def rougher(self) -> PressedInputs:
        return PressedInputs(self._inputs, self._joints, "rougher")

    def contact_force(self, t: float) -> Any:
        return self._force

    def normal(self, t: float) -> Any:
        return self._normal

    def pressing_torque(self, t: float) -> Any:
        return self._pressing


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

    def __init__(self, controller: Any, inputs: Inputs) -> None:
        super().__init__(controller.arm, controller.sample_time)
        self._plan = self._rougher = _Plan(controller)
        path = inputs.array("path_position", 2)
        speed, force_rate = inputs.array("path_speed", 1), inputs.array("reference_force_rate", 1)
        self._surface = SurfaceMotion(*path, *speed, *force_rate)

    def along(self, t: float, reference: Any) -> SurfaceMotion:
        return self._surface


def follow_symbols(controller: Any, inputs: Inputs) -> None:
    """Replace the requested motion of a copy of a controller by symbols."""
    controller._plan = _Plan(controller)
    if isinstance(controller, AdaptiveForce):
        controller._surface = _SurfacePlan(controller, inputs)
