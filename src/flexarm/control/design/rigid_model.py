"""Dynamics of the rigid model of an arm, for controllers of its joints and of its tip."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.control.contract.base import Reference, SampledFeedforward, applied, numbers
from flexarm.control.contract.law_program import is_recorded, recorded_term
from flexarm.control.design.minimal import drifting
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.columns import HAS_JOINT_LAWS
from flexarm.kernels.controller_terms.rigid_terms import SET_COLUMNS, momentum, regressor
from flexarm.kernels.controller_terms.task_dynamics import task_dynamics, tip_torque
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics_many
from flexarm.model.arm.spec import FREE_BASE, serial_only
from flexarm.model.wording import nearest
from flexarm.motion.dynamics.dynamics_along import Actuation
from flexarm.motion.dynamics.following_base import FollowingBase
from flexarm.motion.geometry.inverse_kinematics import rigid_chain, tip_jacobian, tip_jacobian_rate


class RigidModel:
    """Inverse dynamics and mass matrix of the rigid model of an arm, with the same kernels.

    In a closed mechanism accelerations are those of the ``actuated`` joints, by their numbers,
    which the other joints follow, and torques act on these joints alone. A free base follows the
    joints with the momentum zero, as in Papadopoulos and Dubowsky, IEEE Trans. Robotics and
    Automation 7 (1991) 750-758.

    Joint angles, rates and accelerations (joints,) are relative, in rad, rad/s, rad/s^2. Those of
    several runs have the shape (runs, joints), and so have the torques. Arguments are not checked,
    and non-finite arguments give non-finite results.

    Attributes:
        arm: the rigid model. joints: number of joints.
    """

    def __init__(self, arm: Arm, actuated: Sequence[int] | None = None) -> None:
        self.arm = arm.rigid()
        self._base = FollowingBase(self.arm) if self.arm.assembly.base else None
        if drifting(self.arm).size < len(self.arm.assembly.base):  # no instrument reads its place
            rule = (
                "is not supported for a base with springs or dampers, or that turns under gravity"
            )
            raise InputError(Problem("the rigid model of a controller", rule))
        fixed = self.arm if self._base is None else self._base.fixed
        closed = actuated is not None or self.arm.closure_rows
        self._actuation = Actuation(fixed, actuated) if closed else None
        self.joints = arm.n_joints
        self._kernels = kernels = KernelView(self.arm.assembly.constants)
        self._bodies = self.arm.assembly.joint_body
        self._state, self._acceleration = kernels.zeros(2), kernels.zeros()
        self._mass = np.zeros(kernels.shape * 2)
        self._nothing = np.zeros(self.joints)
        self._joint_of = _selection(len(self._mass), self._bodies)

    def torque(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m of a motion: M qdd + bias, gravity included."""
        if angle.ndim > 1:
            return self._torques(angle, rate, acceleration)
        if self._actuation is not None:
            P = self._actuation.motions(angle)
            acceleration = self._actuation.completed(angle, rate, acceleration, P)
            return np.asarray(P.T @ self._force(angle, rate, acceleration))
        return self._force(angle, rate, acceleration)

    def _force(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        """Return the generalised force (joints,) of a motion."""
        if self._base is not None:
            q, qd = self._base.placed(angle), self._base.placed(rate)
            qd[self._base.places] = self._base.rates_at_rest(q, rate)
            qdd = self._base.accelerated(q, qd, acceleration)
            return self.arm.inverse_dynamics(q, qd, qdd)[self.arm.joint_index]
        if is_recorded(angle):
            return self._recorded("inverse_dynamics", angle, rate, acceleration)[self._bodies]
        self._state[0, self._bodies, 0] = angle
        self._state[1, self._bodies, 0] = rate
        self._acceleration[self._bodies, 0] = acceleration
        forces = self._kernels.inverse_dynamics(self._state, self._acceleration)
        torque: FloatArray = forces[self._bodies, 0]
        return torque

    def _recorded(self, term: str, *motion: Any) -> FloatArray:
        """Record the generalised forces (n,) or the mass matrix (n, n) of a motion."""
        motion = (*motion, self._nothing, self._nothing)[:3]
        rows = (np.concatenate([row, [0.0]])[self._joint_of] for row in motion)
        n = len(self._joint_of)
        shape = (n,) if term == "inverse_dynamics" else (n, n)
        result: FloatArray = recorded_term(term, self._kernels, rows, shape)
        return result

    def _torques(self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray) -> FloatArray:
        if self._actuation is not None or self._base is not None:
            return np.array(
                [self.torque(*row) for row in zip(angle, rate, acceleration, strict=True)]
            )
        kernels, count = self._kernels, len(angle)
        states, accelerations = kernels.zeros(count, 2), kernels.zeros(count)
        forces = kernels.zeros(count)
        states[:, 0, self._bodies, 0], states[:, 1, self._bodies, 0] = angle, rate
        accelerations[:, self._bodies, 0] = acceleration
        loads, work = kernels.loads, kernels.work
        kernels.call(inverse_dynamics_many, states, accelerations, loads, work, forces)
        torque: FloatArray = forces[:, self._bodies, 0]
        return torque

    def gravity_torque(self, angle: FloatArray) -> FloatArray:
        """Return the torque (joints,) N m of the arm at rest, joint springs included."""
        return self.torque(angle, self._nothing, self._nothing)

    def mass_matrix(self, angle: FloatArray) -> FloatArray:
        """Return the mass matrix (joints, joints), kg m^2; (runs, joints, joints) of several."""
        if angle.ndim > 1:
            return np.array([self.mass_matrix(one) for one in angle])
        if is_recorded(angle):
            whole = self._recorded("mass_matrix", angle)
        else:
            self._state[0, self._bodies, 0] = angle
            self._kernels.call(mass_matrix, self._state, self._kernels.work, self._mass)
            whole = self._mass[:, 0, :, 0]
        mass = whole[self._bodies][:, self._bodies]
        if self._base is not None:
            of_base, coupling = self._base.split(self._base.placed(angle))
            mass = mass - coupling.T @ np.linalg.solve(of_base, coupling)
        if self._actuation is not None:
            P = self._actuation.motions(angle)
            return np.asarray(P.T @ mass @ P)
        return mass.copy()  # in the layout of that of several, for the same rounding of products


def _selection(count: int, places: Any) -> Any:
    """Return for each of ``count`` numbers its index in ``places``, or the length of these."""
    index = np.full(count, len(places))
    index[places] = np.arange(len(places))
    return index


#: Number of corrections of the sag at the first call. Each one reduces the error by about the ratio
#: of sag to length, for example to a tenth if links sag by a tenth of their length.
_FIRST_CORRECTIONS = 12


class SaggingArm:
    """Static torques of a flexible arm at given joint angles, with sagging links.

    Each call corrects the sag of the previous call once. This is sufficient, because the sag
    changes little between two sample times, and a correction leaves a small fraction of the error.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        assembly = arm.assembly
        self._kernels = KernelView(assembly.constants)
        self._state, self._still = self._kernels.zeros(2), self._kernels.zeros()
        self._bodies = assembly.joint_body
        elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self._places = np.unravel_index(assembly.coordinates[elastic], self._still.shape)
        weightless = Arm(arm.spec.replace(gravity=(0.0, 0.0)))
        stiffness = weightless.stiffness_matrix(weightless.rest(np.zeros(arm.n_joints)))
        self._compliance: Any = np.linalg.inv(stiffness[np.ix_(elastic, elastic)])
        places = [self._bodies * self._still.shape[1], assembly.coordinates[elastic]]
        self._selection = _selection(self._still.size, np.concatenate(places))

    def first_sag(self, angle: FloatArray) -> FloatArray:
        """Return the sag, in elastic coordinates, at the first joint angles."""
        sag = np.zeros(len(self._compliance))
        for _ in range(_FIRST_CORRECTIONS):
            _, sag = self.gravity_torque(angle, sag)
        return sag

    def gravity_torque(self, angle: FloatArray, sag: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torque (joints,) N m at rest, joint springs included, and the next sag."""
        if is_recorded(angle):
            still = np.zeros(2 * self._still.size)
            operands = np.concatenate([angle, sag, [0.0]])[self._selection], still
            shape = self._still.shape
            force = recorded_term("inverse_dynamics", self._kernels, operands, shape)
        else:
            self._state[0, self._bodies, 0] = angle
            self._state[0][self._places] = sag
            force = self._kernels.inverse_dynamics(self._state, self._still)
        torque: FloatArray = force[self._bodies, 0]
        sunk: FloatArray = sag - applied(self._compliance, force[self._places])
        return torque, sunk


#: Column of a set for each parameter of a link and of a joint; the derivative is 1 there.
_LINK = {"mass": 0, "first_moment": 1, "inertia": 3}
_JOINT = {"viscous": 7, "coulomb": 9}
_PAYLOAD = ("mass", "inertia")
#: Columns of joint torques without inertia: damping, stiffness, friction and limits.
_PASSIVE = slice(7, SET_COLUMNS)
_NAME = re.compile(r"(link|joint)_(\d+)\.(\w+)")


class RigidParameters:
    """Regressor of the rigid model's torque, theory page "control under uncertainty", (C.41).

    Args:
        arm: an arm, whose rigid model is used.
        names: parameters of the regressor: "payload.mass" (kg, at the payload's offset),
            "payload.inertia" (kg m^2), "link_1.mass" (kg), "link_1.first_moment" (kg m,
            about the joint), "link_1.inertia" (kg m^2, about the joint, its hub included),
            "joint_1.viscous" (N m s/rad), "joint_1.coulomb" (N m).
        smoothing_rate: (joints,) rad/s, of adapted friction at joints without friction in the arm.

    Attributes:
        names: as given. values: (p,), of the arm. known: number of leading rows of the regressor
            that belong to no parameter. joints: number of joints.

    Arguments of methods are not checked. Results are buffers that the next call overwrites. The
    model has no closures: their forces act as torques of the joints.
    """

    def __init__(
        self, arm: Arm, names: Sequence[str] = (), smoothing_rate: FloatArray | None = None
    ) -> None:
        serial_only(arm.spec, "a controller with parameters of the rigid model", FREE_BASE)
        self.names, self.joints = tuple(names), arm.n_joints
        rigid = arm.rigid()
        exact = rigid.assembly.constants
        self._bodies = rigid.assembly.joint_body
        directions = _directions(rigid, self.names)
        whole = _whole(exact)
        self.values = np.array([_share(whole, d) for d in directions])
        passive = np.zeros_like(whole)
        passive[:, _PASSIVE] = whole[:, _PASSIVE]
        self._split = np.stack([whole - passive, passive])
        rest = whole - sum((v * d for v, d in zip(self.values, directions, strict=True)), 0.0)
        nominal = np.zeros((2, *rest.shape))
        nominal[1, :, _PASSIVE] = rest[:, _PASSIVE]
        nominal[0] = rest - nominal[1]
        # The kernel requires the inertial sets first. ``_order`` restores the order of the names.
        is_passive = [False, True, *(bool(d[:, _PASSIVE].any()) for d in directions)]
        first = np.argsort(is_passive, kind="stable")
        self._sets = np.stack([*nominal, *directions])[first]
        self._inertial = is_passive.count(False)
        self._order = np.argsort(first)
        self.known = 2
        constants = ArmConstants(*(array.copy() for array in exact))
        constants.arm[HAS_JOINT_LAWS] = 1.0
        if smoothing_rate is not None:
            for joint, number in enumerate(arm.joint_numbers):
                if arm.spec.joints[number - 1].friction is None:
                    constants.friction[self._bodies[joint], 3] = smoothing_rate[joint]
        self._kernels = kernels = KernelView(constants)
        self._state, self._acceleration = kernels.zeros(2), kernels.zeros()
        self._motion = np.zeros((4, self.joints))
        self._angle, self._rate = np.zeros(self.joints), np.zeros(self.joints)
        self._columns = np.zeros((len(self._sets), self.joints))
        self._unit, self._found = np.zeros(self.joints), np.zeros((2, self.joints))

    def regressor(
        self,
        angle: FloatArray,
        rate: FloatArray,
        reference_rate: FloatArray,
        reference_acceleration: FloatArray,
        ordered: bool = True,
    ) -> FloatArray:
        """Return rows (known + p, joints) of M qdd_r + C(q, qd) qd_r + g + losses(qd_r).

        The sum of the first ``known`` rows is the torque that does not depend on a parameter; each
        other row is the torque per unit of its parameter. Without ``ordered`` the rows have the
        order of ``placed``, which is faster.
        """
        if is_recorded(angle):
            rows = angle, rate, reference_rate, reference_acceleration
            columns = self._recorded("regressor", rows, self._sets, self._inertial)
            return columns[self._order] if ordered else columns
        motion = self._motion
        motion[0], motion[1] = angle, rate
        motion[2], motion[3] = reference_rate, reference_acceleration
        work = self._kernels.loads, self._kernels.work, self._sets, self._inertial, self._bodies
        buffers = self._state, self._acceleration, self._columns
        self._kernels.call(regressor, *work, motion, *buffers)
        return self._columns[self._order] if ordered else self._columns

    def _recorded(self, term: str, rows: Any, sets: Any, inertial: int = 0) -> FloatArray:
        """Record the columns (sets, joints) of a term."""
        parameters = self._bodies, sets, inertial
        shape = len(sets), self.joints
        columns: FloatArray = recorded_term(term, self._kernels, rows, shape, *parameters)
        return columns

    def placed(self, numbers: FloatArray) -> FloatArray:
        """Return numbers (known + p,) in the order of the rows of the unordered ``regressor``."""
        found = np.empty_like(numbers)
        found[self._order] = numbers
        return found

    def momentum(self, angle: FloatArray, rate: FloatArray) -> FloatArray:
        """Return M qd and its rate without motors, C' qd - g - losses, (2, joints)."""
        if is_recorded(angle):
            rows = angle, rate, np.zeros(2 * self.joints)
            return self._recorded("momentum", rows, self._split)
        self._angle[:], self._rate[:] = angle, rate
        work = self._kernels.loads, self._kernels.work, self._split, self._bodies
        buffers = self._angle, self._rate, self._unit, self._state, self._acceleration
        self._kernels.call(momentum, *work, *buffers, self._found)
        return self._found


def _directions(rigid: Arm, names: Sequence[str]) -> list[FloatArray]:
    """Return the derivative of the whole set (n, SET_COLUMNS) by each parameter."""
    known = parameter_names(rigid)
    problems = []
    for i, name in enumerate(names):
        if not isinstance(name, str) or name not in known:
            rule = f"be names from {', '.join(known)}"
            problems.append(Problem("parameters", rule, shown(name), nearest(name, known)))
        elif name in names[:i]:
            problems.append(Problem("parameters", f"repeats {name!r}"))
    raise_any(problems)
    return [_direction(rigid, name) for name in names]


def parameter_names(arm: Arm) -> tuple[str, ...]:
    """Return the names of all parameters of an arm for ``RigidParameters``."""
    links = [f"link_{i}.{name}" for i in range(1, arm.n_links + 1) for name in _LINK]
    joints = [f"joint_{i}.{name}" for i in arm.joint_numbers for name in _JOINT]
    return (*links, *joints, *(f"payload.{name}" for name in _PAYLOAD))


def _direction(rigid: Arm, name: str) -> FloatArray:
    assembly = rigid.assembly
    direction = np.zeros((assembly.bodies, SET_COLUMNS))
    found = _NAME.fullmatch(name)
    if found is not None:
        number, kind = int(found[2]), found[3]
        if found[1] == "link":
            direction[assembly.link_body[number - 1], _LINK[kind]] = 1.0
        else:
            joint = list(rigid.joint_numbers).index(number)
            direction[assembly.joint_body[joint], _JOINT[kind]] = 1.0
        return direction
    payload = rigid.spec.payload
    x, y = payload.offset
    if name == "payload.inertia":
        direction[-1, 3 if payload.mass > 0.0 and (x or y) else 5] = 1.0
    elif payload.mass > 0.0 and (x or y):  # the payload is a separate body
        direction[-1, :4] = 1.0, x, y, x * x + y * y
    else:
        direction[-1, 4] = 1.0
    return direction


def _whole(constants: ArmConstants) -> FloatArray:
    """Return the set of all constants of the rigid model, (n, SET_COLUMNS)."""
    c = constants
    columns = [c.mass, c.first_moment_x, c.first_moment_y, c.inertia, c.tip_mass, c.tip_inertia]
    columns += [c.rotor[:, 0], c.joint_damping, c.joint_stiffness]
    columns += [c.friction[:, 0], c.friction[:, 1], c.friction[:, 4], c.limits[:, 2]]
    columns += [c.friction[:, 5], c.friction[:, 6]]
    return np.stack(columns, axis=1)


def _share(whole: FloatArray, direction: FloatArray) -> float:
    """Return the value of a parameter of the arm."""
    first = np.unravel_index(np.argmax(direction != 0.0), direction.shape)
    return float(whole[first] / direction[first])


class TaskState(NamedTuple):
    """State of the rigid model, overwritten by the next one; tip vectors in world axes."""

    motion: FloatArray  # (3, 2): position m, velocity m/s, acceleration at qdd = 0 m/s^2
    jacobian: FloatArray  # (2, joints) m
    mass: FloatArray  # (joints, joints) kg m^2
    bias_torque: FloatArray  # (joints,) N m: torque at qdd = 0


class TaskSpace:
    """Kinematics and dynamics of the rigid model at its tip, without checks of arguments."""

    _tip_torque = staticmethod(tip_torque)

    def __init__(self, arm: Arm) -> None:
        serial_only(arm.spec, "a controller of the tip")
        assembly = arm.rigid().assembly
        self._kernels = kernels = KernelView(assembly.constants)
        moved = KernelView(assembly.constants, complex)
        self.joints = count = arm.n_joints
        shapes = (3, 2), (2, count), (count, count), (count,)
        self._state = TaskState(*map(np.zeros, shapes))
        self._angle, self._rate = np.zeros(arm.n_joints), np.zeros(arm.n_joints)
        motion = assembly.joint_body, self._angle, self._rate
        work = kernels.loads, kernels.zeros(2), kernels.zeros(), kernels.work
        buffers = moved.zeros(2), *moved.pose_arrays(), np.zeros((2, assembly.bodies))
        matrix = np.zeros(kernels.shape * 2)
        self._arguments = *motion, *work, *buffers, matrix, *self._state

    def at(self, angle: FloatArray, rate: FloatArray) -> TaskState:
        """Return the state at joint angles (rad) and rates (rad/s), (joints,) each."""
        self._angle[:], self._rate[:] = angle, rate
        self._kernels.call(task_dynamics, *self._arguments)
        return self._state

    def torque(
        self,
        state: TaskState,
        acceleration: tuple[float, float],
        push: tuple[float, float],
        posture: FloatArray,
        added: FloatArray,
    ) -> FloatArray:
        """Return the torques (joints,) N m for an acceleration and a force of the tip: (F.1)."""
        torque = np.empty_like(state.bias_torque)
        self._tip_torque(*state, posture, *acceleration, *push, added, torque)
        return torque


class TaskReference(NamedTuple):
    """Requested tip motion, force and joint motion at one instant, for the rigid model."""

    x: float  # of the tip, m, world axes
    y: float
    x_rate: float  # m/s
    y_rate: float
    x_acceleration: float  # m/s^2
    y_acceleration: float
    force: float  # N, on the surface
    normal_x: float  # of the surface, pointing away from it; 0, 0 without a force
    normal_y: float
    curvature: float  # of the surface, 1/m, positive if it is convex
    angle: FloatArray  # (joints,) rad
    rate: FloatArray  # (joints,) rad/s
    acceleration: FloatArray  # (joints,) rad/s^2
    pressing: FloatArray  # (joints,) N m, in addition to the rigid model with the force, (F.3)


#: Number of scalar fields of ``TaskReference``.
NUMBERS = 10


class _SampledRows:
    """Rows of numbers along a reference at the sample times.

    A reference with ``vectorized`` true accepts arrays of times, and is evaluated at many sample
    times at once.
    """

    def __init__(self, sample_time: float) -> None:
        self._sample_time = sample_time
        self.reset()

    def reset(self) -> None:
        """Clear the reference."""
        self._reference: Any = None
        self._sampled: SampledFeedforward | None = None
        self.vectorized = False

    def row(self, t: float, reference: Any) -> FloatArray:
        """Return the row (n,) at t (s)."""
        if self._sampled is None or reference is not self._reference:
            self._reference = reference
            self.vectorized = bool(getattr(reference, "vectorized", False))
            self._sampled = SampledFeedforward(self, self._sample_time)
        return self._sampled(t)

    def __call__(self, t: Any) -> FloatArray:
        """Return the row at a time, or rows at times (T,), of the last reference."""
        rows = self.rows(self._reference, np.atleast_1d(np.asarray(t, dtype=np.float64)))
        return rows if np.ndim(t) else rows[0]

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows (T, n) at times (T,)."""
        raise NotImplementedError


class TaskPlan(_SampledRows):
    """Plan of the requested tip motion along a reference: the numbers of ``TaskReference``.

    A reference without ``contact_force``, ``normal`` and ``pressing_torque`` requests no force.
    """

    def __init__(self, arm: Arm, sample_time: float) -> None:
        super().__init__(sample_time)
        self._chain, self._joints = rigid_chain(arm), arm.n_joints

    def request(self, row: FloatArray) -> TaskReference:
        """Return the request with the numbers of a row."""
        n = self._joints
        a, b, c, d = (NUMBERS + k * n for k in range(4))
        of_tip: Any = row[:NUMBERS].tolist()
        arrays: Any = (row[a:b], row[b:c], row[c:d], row[d : d + n])
        return TaskReference(*of_tip, *arrays)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows (T, numbers) at times (T,)."""
        names = "joint_angle", "joint_rate", "joint_acceleration"
        angle, rate, acceleration = (values_of(reference, name, t) for name in names)
        lengths, turned = self._chain.lengths, angle + self._chain.offset
        J, J_rate = tip_jacobian(lengths, turned), tip_jacobian_rate(lengths, turned, rate)
        velocity = np.einsum("tij,tj->ti", J, rate)
        tip_acceleration = np.einsum("tij,tj->ti", J, acceleration)
        tip_acceleration += np.einsum("tij,tj->ti", J_rate, rate)
        # The arrays have the type of the angles, which are symbols in exported controllers.
        force, normal, curved = (np.zeros_like(angle, shape=(len(t), count)) for count in (1, 2, 1))
        pressing = np.zeros_like(angle)
        if hasattr(reference, "contact_force"):
            force[:, 0] = values_of(reference, "contact_force", t)
            normal[:] = values_of(reference, "normal", t)
            pressing[:] = values_of(reference, "pressing_torque", t)
            pressing += np.einsum("tij,ti->tj", J, force * normal)
        if hasattr(reference, "curvature"):
            curved[:, 0] = values_of(reference, "curvature", t)
        of_tip = (self._chain.tip(angle), velocity, tip_acceleration, force, normal, curved)
        return np.concatenate([*of_tip, angle, rate, acceleration, pressing], axis=1)


def values_of(reference: Any, name: str, t: FloatArray) -> FloatArray:
    """Evaluate one method of a reference at times (T,)."""
    function = getattr(reference, name)
    if getattr(reference, "vectorized", False):
        return np.asarray(function(t), dtype=np.float64)
    return np.concatenate([numbers(function(now))[None] for now in t.tolist()])


class SurfaceMotion(NamedTuple):
    """Requested motion of the tip along a surface at one instant."""

    x: float  # of the tip of the bent arm, m, world axes
    y: float
    speed: float  # along the tangent (-normal_y, normal_x), m/s
    force_rate: float  # N/s


class SurfacePlan(_SampledRows):
    """Plan of the requested motion along the surface; at rest for a reference without ``tip``."""

    def along(self, t: float, reference: Reference) -> SurfaceMotion:
        """Return the requested motion along the surface at t (s)."""
        row: Any = self.row(t, reference).tolist()
        return SurfaceMotion(*row)

    def rows(self, reference: Any, t: FloatArray) -> FloatArray:
        """Return rows of ``SurfaceMotion`` at times (T,), with central differences as rates."""
        rows = np.zeros((len(t), 4))
        before, after = t - self._sample_time, t + self._sample_time
        over = 2.0 * self._sample_time
        if hasattr(reference, "tip"):
            rows[:, :2] = values_of(reference, "tip", t)[..., :2]
            rates = values_of(reference, "tip", after) - values_of(reference, "tip", before)
            normal = values_of(reference, "normal", t)
            rows[:, 2] = (normal[:, 0] * rates[:, 1] - normal[:, 1] * rates[:, 0]) / over
        force = values_of(reference, "contact_force", after)
        rows[:, 3] = (force - values_of(reference, "contact_force", before)) / over
        return rows
