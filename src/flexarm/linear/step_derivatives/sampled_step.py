"""Nonlinear steps of an arm over sample times, and their exact derivatives."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, IntArray
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.closed import refuse_opening
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import (
    InputError,
    Problem,
    check_array,
    problems_of,
    public_call,
    raise_any,
    shown,
)
from flexarm.integrate import INTEGRATORS, REMOVED
from flexarm.integrate.base import Drive, System
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive, AdditiveTableau, additive_record
from flexarm.integrate.memory import new_memory
from flexarm.integrate.step_sensitivity import (
    held_torque_additive_step,
    held_torque_jacobian,
    held_torque_step,
)
from flexarm.integrate.transfers import held_torque_transfers
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants, Workspace
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.parameters import check_closed_form, constants_at, same_arrays
from flexarm.model.paths import number_at, with_number
from flexarm.model.quantities import Positive


@dataclass(frozen=True, eq=False)
class StepJacobian:
    """One step from x = [q, qd] to x', and its derivatives, exact to rounding.

    Attributes:
        q, qd: (dof,) after the step.
        state: (2 dof, 2 dof) by [q, qd] before it.
        torque: (2 dof, joints) by the constant torque during the step, N m.
        parameters: for each requested parameter, (2 dof,) by it, at constant initial q and qd.
    """

    q: FloatArray
    qd: FloatArray
    state: FloatArray
    torque: FloatArray
    parameters: dict[str, FloatArray]

    def __repr__(self) -> str:
        by = [f"{self.state.shape[1]} states", f"{self.torque.shape[1]} torques", *self.parameters]
        return f"<flexarm.StepJacobian: {self.state.shape[0]} states by {', '.join(by)}>"


@public_call
def step_jacobian(
    arm: Arm,
    q: ArrayLike,
    qd: ArrayLike,
    torque: ArrayLike,
    step: Positive,
    *,
    method: str = "rk4",
    parameters: Sequence[str] = (),
) -> StepJacobian:
    """Compute one step of an integrator and its exact derivatives.

    Args:
        arm: the arm.
        q, qd: (dof,) before the step.
        torque: (joints,) N m, constant during the step.
        step: length of the step, s.
        method: a one-step method of ``flexarm.integrate.INTEGRATORS``, explicit or implicit in
            bending. A method with step control takes this step without control.
        parameters: paths of numbers of the arm, such as payload.mass or links[0].length. The
            effect of a number on the equations must have a closed form.

    Raises:
        InputError: if an argument has the wrong shape or value, the method is not a one-step
            method, a parameter is not supported, or the state does not close the loops.

    Warns:
        AccuracyWarning: friction has bristles, which a step of q and qd does not contain.

    The derivatives by parameters are at constant modal coordinates, not constant nodal ones.
    Chained over steps they give the derivative of a whole run of ``simulate`` from straight links.
    Computed by complex perturbation of the kernels of the integrator; (D.15).
    """
    warn_of_bristles(arm, "the step")
    parameters = check_list_of("parameters", parameters, str)
    state = [check_array(n, v, (arm.dof,)) for n, v in (("q", q), ("qd", qd))]
    refuse_opening(arm, ("q", "qd"), state[0], state[1])
    held = check_array("torque", torque, (arm.n_joints,))
    step_of = stepper_of(arm, method, step)
    x, tau = np.concatenate(state), arm.padded_torque(held)
    exact = arm.assembly.constants
    moved_states = x + 1j * STEP * np.eye(x.size)
    columns = [step_of(moved_state, tau, exact).imag / STEP for moved_state in moved_states]
    pushes = arm.padded_torque(held + 1j * STEP * np.eye(arm.n_joints))
    inputs = [step_of(x, push, exact).imag / STEP for push in pushes]
    named = {}
    for path in parameters:
        value = number_at("parameters", arm.spec, path)
        check_closed_form("parameters", arm, path)
        moved, _ = constants_at(arm, {path: value + 1j * STEP}, complex)
        named[path] = step_of(x, tau, moved).imag / STEP
    after = step_of(x, tau, exact).real
    by_torque = np.stack(inputs, axis=1) if inputs else np.zeros((x.size, 0))
    by_state = np.stack(columns, axis=1)
    return StepJacobian(after[: arm.dof], after[arm.dof :], by_state, by_torque, named)


def stepper_of(arm: Arm, method: str, h: float) -> Callable[..., FloatArray]:
    """Return a step of length h (s) of a method whose step depends on the state alone.

    It is a function of [q, qd] (2 dof,), the torque (n,) of each body and the constants, and
    returns [q, qd] after the step, complex.
    """
    kind = INTEGRATORS.get(method) if isinstance(method, str) else None
    kernels = KernelView(arm.assembly.constants, complex)
    if kind is not None and issubclass(kind, ExplicitRungeKutta):
        return _explicit_step(arm, kernels, _rows_of(kind), h)
    if kind is not None and issubclass(kind, Additive):
        return partial(_additive_step, arm, kernels, kind.tableau, h)
    kinds = ExplicitRungeKutta, Additive
    names = [name for name, k in INTEGRATORS.items() if issubclass(k, kinds)]
    rule = f"be one of {', '.join(map(repr, names))}"
    hint = ""
    if isinstance(method, str) and method in REMOVED:
        hint = f"It was removed; use {REMOVED[method]!r}."
    elif kind is not None:
        hint = "Multistep and iterative methods are not supported."
    raise InputError(Problem("method", rule, shown(method), hint))


def _explicit_step(
    arm: Arm, kernels: KernelView, rows: FloatArray, h: float
) -> Callable[..., FloatArray]:
    """Return the step of an explicit Runge-Kutta method with complex numbers."""
    stages, after = kernels.zeros(len(rows) - 1, 2), kernels.zeros(2)

    def step(x: FloatArray, torque: FloatArray, constants: ArmConstants) -> FloatArray:
        state = arm.padded(x.reshape(2, -1)).astype(complex)
        point = state, torque.astype(complex), kernels.loads, kernels.work, stages, after
        held_torque_step(kernels.sizes, _complex(constants), rows, h, *point)
        return arm.unpadded(after).ravel()

    return step


def _additive_step(
    arm: Arm,
    kernels: KernelView,
    tableau: AdditiveTableau,
    h: float,
    x: FloatArray,
    torque: FloatArray,
    constants: ArmConstants,
) -> FloatArray:
    """Return [q, qd] after a step that is implicit in bending, with complex numbers."""
    numbers, span, nothing = _complex(constants), np.array([0.0, 1.0]), np.zeros((1, 4, 0))
    coefficients = np.zeros((1, 4, torque.size), dtype=complex)
    coefficients[0, 0] = torque
    amplitude = np.zeros((0, 3))
    drive = Drive(span, coefficients, np.zeros(0), kernels.loads, amplitude, span, nothing)
    state = arm.padded(x.reshape(2, -1)).astype(complex)
    memory = new_memory(state, h)
    record = additive_record(tableau, numbers, state)
    system = System(kernels.sizes, numbers, drive, kernels.work)
    held_torque_additive_step(system, record, memory, h)
    return arm.unpadded(memory.new).ravel()


def _complex(constants: ArmConstants) -> ArmConstants:
    """Convert all constants to complex numbers, so that the kernels compile only once."""
    return ArmConstants(*(array.astype(complex) for array in constants))


#: Largest product of step and fastest rate. The relative error of the frequency of the fastest
#: mode is then 0.2^4 / 120 = 1.3e-5 with the classical Runge-Kutta method. A filter interprets a
#: frequency error as a mass error: at a product of 1.0 its errors were ten times as large as its
#: covariance predicts.
REACH = 0.2


class Step(NamedTuple):
    """A state after one sample time, and its derivatives."""

    after: FloatArray  # (2 dof,) [q, qd]
    state: FloatArray  # (2 dof, 2 dof) by the state before
    torque: FloatArray  # (2 dof, joints) by the zero-order-hold torque, N m
    parameters: FloatArray  # (2 dof, p) by the parameters


class SampledStep:
    """Steps of an arm over a sample time under a zero-order-hold torque, with free parameters.

    The steps are those of ``step_jacobian`` with the method "rk4". Their number follows from the
    fastest mode of the arm and ``reach``, the largest product of step and fastest rate. They are
    compiled as a whole, for filters that step at every sample. ``parameters`` is not empty.
    """

    def __init__(
        self,
        arm: Arm,
        sample_time: float,
        parameters: Sequence[str] = ("payload.mass",),
        reach: float = REACH,
    ) -> None:
        self.arm = arm
        self.steps = max(1, math.ceil(sample_time * fastest_rate(arm) / reach))
        self._h = sample_time / self.steps
        self.free = FreeParameters(arm, parameters)
        self.places = state_places(arm)
        self._rows = classical()
        self._kernels = kernels = KernelView(arm.assembly.constants, complex)
        self._stages = kernels.zeros(len(self._rows) - 1, 2)
        self._before, self._new = kernels.zeros(2), kernels.zeros(2)
        self._slopes = np.zeros((len(self.places) + arm.n_joints + 1, 2, *kernels.shape))

    def take(self, x: FloatArray, torque: FloatArray, changes: FloatArray | None = None) -> Step:
        """Advance [q, qd] (2 dof,) by one sample time, with ``changes`` (p,) of the parameters."""
        arm = self.arm
        plain, moved = self.free.at(changes)
        self._carry(x, torque, (plain, moved[0]), self.places, arm.assembly.joint_body)
        slopes = arm.unpadded(self._slopes).reshape(len(self._slopes), -1).T
        size, parameters = 2 * arm.dof, [slopes[:, -1].copy()]
        found = Step(self._after(), slopes[:, :size], slopes[:, size:-1], slopes[:, -1:])
        for one in moved[1:]:
            self._carry(x, torque, (plain, one), self.places[:0], arm.assembly.joint_body[:0])
            parameters.append(arm.unpadded(self._slopes[-1]).ravel())
        return found._replace(parameters=np.stack(parameters, axis=1))

    def advance(
        self, x: FloatArray, torque: FloatArray, changes: FloatArray | None = None
    ) -> FloatArray:
        """Return the state [q, qd] (2 dof,) of ``take``, without its derivatives."""
        plain, _ = self.free.at(changes)
        self._carry(x, torque, (plain, plain), self.places[:0], self.arm.assembly.joint_body[:0])
        return self._after()

    def _after(self) -> FloatArray:
        return self.arm.unpadded(self._new.real).ravel()

    def _carry(
        self,
        x: FloatArray,
        torque: FloatArray,
        constants: tuple[ArmConstants, ArmConstants],
        places: IntArray,
        bodies: IntArray,
    ) -> None:
        """Write the state after the steps to ``_new``, and the last derivatives to ``_slopes``."""
        arm = self.arm
        plain, moved = constants
        kernels, count = self._kernels, 1 + len(places) + len(bodies)
        state, tau = arm.padded(x.reshape(2, -1)), arm.padded_torque(torque)
        steps = self._rows, self._h, self.steps, places, bodies
        point = state.astype(complex), tau.astype(complex), kernels.loads, kernels.work
        buffers = self._stages, self._before, self._new, self._slopes[-count:]
        held_torque_jacobian(kernels.sizes, plain, moved, *steps, *point, *buffers)


def state_places(arm: Arm) -> IntArray:
    """Return level, body and column of each state [q, qd] in the kernels' layout, (2 dof, 3)."""
    body, column = np.divmod(arm.assembly.coordinates, 1 + arm.assembly.modes)
    levels = [np.stack([np.full_like(body, level), body, column], axis=1) for level in range(2)]
    return np.concatenate(levels)


def fastest_rate(arm: Arm) -> float:
    """Return the largest modulus of the poles at rest with zero joint angles, 1/s."""
    zero = np.zeros(arm.dof)
    small = arm.derivatives(zero, zero, np.zeros(arm.n_joints))
    eye = np.eye(arm.dof)
    A = np.block([[np.zeros_like(eye), eye], [small.q, small.qd]])
    return float(abs(np.linalg.eigvals(A)).max())


def classical() -> FloatArray:
    """Return the classical Runge-Kutta method as the rows of ``held_torque_step``."""
    return _rows_of(INTEGRATORS["rk4"])


def _rows_of(kind: Any) -> FloatArray:
    """Return an explicit method as the rows of ``held_torque_step``."""
    tableau = kind().tableau
    return np.ascontiguousarray(tableau.A[: tableau.stages + 1, : tableau.stages + 1])


#: Relative change of a number (absolute if it is zero) for which formula and assembly must agree.
_PROBE = 1e-3
#: Relative tolerance of constants that are equal: rounding of eigenvectors, far below ``_PROBE``.
_SAME = 1e-7


class FreeParameters:
    """Constants of an arm for changed values of some of its numbers, with exact derivatives.

    The ``paths`` are those of numbers of joints, payload, gravity, damping, and rigidities of whole
    links, whose ``values`` (p,) are those of the arm. A number that changes mode shapes, points or
    coordinates is refused. ``name`` is that of the argument in messages.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], name: str = "parameters") -> None:
        problems = [p for path in paths for p in problems_of(_check, arm, path, name)]
        raise_any(problems)
        self._arm, self._paths = arm, tuple(paths)
        self.values = np.array([number_at(name, arm.spec, path) for path in paths])
        self._exact = ArmConstants(*(a.astype(complex) for a in arm.assembly.constants))
        self._by = [self._slope(k) for k in range(len(paths))]
        # All numbers change at once, each by another fraction, so that products are noticed.
        moved = np.where(self.values, 0.1 * self.values, _PROBE) * (1.0 + np.arange(len(paths)))
        self._affine = same_arrays(self._by_formula(moved), self._linear(moved), _SAME)

    def at(
        self, changes: FloatArray | None = None
    ) -> tuple[ArmConstants, tuple[ArmConstants, ...]]:
        """Return the complex constants for changes (p,) of the numbers, by default zero.

        The second value has, for each number, the constants with its imaginary step ``STEP``.
        """
        changes = np.zeros(self.values.size) if changes is None else changes
        if not self._affine:
            steps = 1j * STEP * np.eye(len(self._paths))
            moved = tuple(self._by_formula(changes + step) for step in steps)
            return self._by_formula(changes), moved
        plain = self._linear(changes)
        return plain, tuple(
            ArmConstants(
                *(c if d is None else c + 1j * STEP * d for c, d in zip(plain, by, strict=True))
            )
            for by in self._by
        )

    def _linear(self, changes: FloatArray) -> ArmConstants:
        found = list(self._exact)
        for change, by in zip(changes, self._by, strict=True):
            if change:
                for k, slope in enumerate(by):
                    if slope is not None:
                        found[k] = found[k] + change * slope
        return ArmConstants(*found)

    def _by_formula(self, changes: Any) -> ArmConstants:
        values = dict(zip(self._paths, self.values + changes, strict=True))
        return constants_at(self._arm, values, complex)[0]

    def _slope(self, place: int) -> list[FloatArray | None]:
        """Return the derivatives of the arrays of constants, None for those that are zero."""
        step = np.zeros(len(self._paths), dtype=complex)
        step[place] = 1j * STEP
        slopes = [np.imag(array) / STEP for array in self._by_formula(step)]
        return [slope if np.any(slope) else None for slope in slopes]


def _check(arm: Arm, path: str, name: str) -> None:
    """Raise unless the constants depend on a number by formulas that leave all points unchanged."""
    value = number_at(name, arm.spec, path)
    other = value * (1.0 + _PROBE) if value else _PROBE
    changed = Arm(with_number(arm.spec, path, other))
    found, rows = constants_at(arm, {path: other}, float)
    before, gauges = arm.assembly.constants, constants_at(arm, {}, float)[1]
    moved = rows - gauges, found.length - before.length, found.S - before.S
    alike = all(np.array_equal(one, two) for one, two in zip(before, found, strict=True))
    # Without an effect here, a number is a place of a gauge; q and qd do not contain bristles.
    if ".bristle_" in path or (alike and not np.any(rows - gauges)):
        rule = "have an effect on the model of a filter"
        raise InputError(Problem(name, rule, shown(path)))
    if same_arrays(changed.assembly.constants, found, _SAME) and not any(
        np.any(part) for part in moved
    ):
        return
    rule = (
        "be a number of the joints, the payload, gravity, damping or the rigidity of a whole link"
    )
    hint = "" if value else "It is 0 in this arm, so that the equations may omit its terms."
    raise InputError(Problem(name, rule, shown(path), hint))


#: Largest product of step and fastest rate. The classical Runge-Kutta method changes the frequency
#: of the fastest mode by 0.8 % and its amplitude by 0.7 % in a step. With 2.0, 25 % of its
#: amplitude in a step, control of an arm without damping was unstable.
_REACH = 1.0
#: Largest product of time and fastest rate of a Taylor polynomial of degree 6: a relative error of
#: 1.5e-6, and of 2e-4 for rates twice as large as at rest.
_TURNED = 0.5


class Steps(NamedTuple):
    """States after one to N sample times, and their derivatives."""

    after: FloatArray  # (N, 2 dof) [q, qd]
    state: FloatArray  # (N, 2 dof, 2 dof) by the state one sample time before
    torque: FloatArray  # (N, 2 dof, joints) by the zero-order-hold torque of that time, N m


class SampledSteps:
    """Steps of an arm over up to ``most`` sample times (s) under zero-order-hold torques.

    The steps are those of the method "rk4" and their number follows from the fastest mode of the
    arm, as in `SampledStep`, but they are coarser, for controllers. The derivatives are those of
    linear motion about every second sample, sampled exactly, and interpolated between these: their
    error is of second order in the sample time.
    """

    def __init__(self, arm: Arm, sample_time: float, most: int) -> None:
        turned = sample_time * fastest_rate(arm)
        self.steps = max(1, math.ceil(turned / _REACH))
        self._h, self._A = sample_time / self.steps, classical()
        self._doublings = max(0, math.frexp(turned / _TURNED)[1])
        self._size, self._joints = 2 * arm.dof, arm.n_joints
        self._view = view = KernelView(arm.assembly.constants)
        self._places, self._bodies = arm.assembly.coordinates, arm.assembly.joint_body
        n, shape = view.shape[0], (2, *view.shape)
        self._torques, self._motion = np.zeros((most, n)), view.zeros(most + 1, 2)
        self._plain = [view.zeros(2), np.zeros(n), view.zeros(2), np.zeros(n)]
        self._buffers = view.zeros(len(self._A) - 1, 2), view.zeros(2)
        self._entry = Entry(held_torque_transfers)
        # A step of Euler's method over a sample time changes by the Jacobian times this time.
        euler = view.sizes, view.constants, np.array([[0.0, 0.0], [1.0, 0.0]]), sample_time, 1
        self._state, self._torque = Duals.zeros(*shape), np.zeros((1, n))
        arrays = {name: Duals.zeros(*array.shape) for name, array in view.work._asdict().items()}
        work = Workspace(**arrays)  # type: ignore[arg-type]
        self._moved = Duals.zeros(1, *shape)
        buffers = work, Duals.zeros(1, *shape), Duals.zeros(*shape), self._moved
        scratch = self._state, Duals.zeros(n), view.loads, *buffers
        seeds = [self._block(arm, k) for k in range(0, self._size + arm.n_joints, DIRECTIONS)]
        self._blocks = [(*euler, self._torque, *block, *scratch) for block in seeds]
        self._entries = [Entry(held_torque_transfers) for _ in seeds]
        self._changes = np.zeros((most // 2 + 2, len(seeds), *self._moved.array.shape[1:]))

    def _block(self, arm: Arm, first: int) -> tuple[Duals, Duals]:
        """Return unit changes of states and torques in eight directions from ``first`` on."""
        units = np.eye(self._size + self._joints)[first : first + DIRECTIONS]
        states = arm.padded(units[:, : self._size].reshape(-1, 2, arm.dof))
        torques = arm.padded_torque(units[:, self._size :])
        nothing = np.zeros(states.shape[1:]), np.zeros(torques.shape[1])
        return Duals.of(nothing[0], states), Duals.of(nothing[1], torques)

    @np.errstate(over="ignore", invalid="ignore")
    def take(self, x: FloatArray, torques: FloatArray) -> Steps:
        """Advance [q, qd] (2 dof,) under torques (N, joints) N m of N sample times."""
        count, view, size = len(torques), self._view, self._size
        motion = self._motion[: count + 1]
        self._torques[:count, self._bodies] = torques
        motion[0].reshape(2, -1)[:, self._places] = x.reshape(2, -1)
        self._plain[2][:] = motion[0]
        self._entry(
            view.sizes, view.constants, self._A, self._h, self.steps, self._torques, *self._plain,
            view.loads, view.work, *self._buffers, motion[1:],
        )  # fmt: skip
        # From the samples 0, 2, 4, ... and the last to the middle of each sample time.
        at, pair = np.append(np.arange(0, count, 2), count), np.arange(count) // 2
        held = np.vstack([torques[:1], torques, torques[-1:]])
        nodes = self._sampled(motion[at], 0.5 * (held[at] + held[at + 1]))
        share = ((np.arange(count) + 0.5 - at[pair]) / np.diff(at)[pair])[:, None, None]
        slopes = (1.0 - share) * nodes[pair] + share * nodes[pair + 1]
        after = motion[1:].reshape(count, 2, -1)[:, :, self._places].reshape(count, size)
        return Steps(after, slopes[..., :size], slopes[..., size:])

    def _sampled(self, nodes: FloatArray, torques: FloatArray) -> FloatArray:
        """Return derivatives (k, 2 dof, 2 dof + joints) over a sample of motion about k states."""
        k, size, start, moved = len(nodes), self._size, self._state.array, self._moved.array
        for node, torque, changes in zip(nodes, torques, self._changes, strict=False):
            self._torque[0, self._bodies] = torque
            for entry, arguments, change in zip(self._entries, self._blocks, changes, strict=True):
                start[..., 0] = node
                entry(*arguments)
                change[:] = moved[0]
        by = self._changes[:k].reshape(k, len(self._blocks), 2, -1, 1 + DIRECTIONS)
        by = np.moveaxis(by[:, :, :, self._places, 1:], 1, 3).reshape(k, size, -1)
        whole = np.zeros((k, size + self._joints, size + self._joints))
        whole[:, :size] = by[..., : whole.shape[2]]
        whole[:, :size, :size] -= np.eye(size)
        return _exponentials(whole, self._doublings)[:, :size]


def _exponentials(matrices: FloatArray, doublings: int) -> FloatArray:
    """Return the exponentials of matrices (k, n, n): Taylor's polynomial of degree 6, doubled."""
    Z, unit = matrices / 2.0**doublings, np.eye(matrices.shape[1])
    square = Z @ Z
    cube = square @ Z
    moved = unit + Z + square / 2.0 + cube @ (unit / 6.0 + Z / 24.0 + square / 120.0 + cube / 720.0)
    for _ in range(doublings):
        moved = moved @ moved
    return moved
