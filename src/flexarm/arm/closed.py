"""Motions that keep the loops of a mechanism closed, the forces of closures, and closed postures.

With the Jacobian ``J`` of the closures, small motions ``Z y`` in independent coordinates ``y`` keep
the loops closed, ``J Z = 0``. An equilibrium is ``f = J' lambda`` for the force ``f`` that rest
requires: ``Z' f = 0``, and the rows of ``f`` that belong to the dependent coordinates give
``lambda``. The stiffness is the derivative of ``f - J' lambda``: it contains the curvature of the
closures, without which frequencies are wrong. Theory page "small motion",
(S.11) to (S.13).
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, IntArray
from flexarm.arm.assembly.coordinates import check_joint, coordinate_sizes, once_per_arm
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.bending import bending_warning
from flexarm.arm.dynamics import gaps_by_q
from flexarm.base.arguments import as_list
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.base.late import linalg
from flexarm.kernels.columns import GAP, GAP_RATE
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import ArmConstants
from flexarm.kernels.recursion.closures import ROW_ANGLE, closure_gaps
from flexarm.model import Contact, Load

#: Gap, in units of the reach or one radian, up to which a posture counts as closed: postures with
#: six digits shall do.
_OPEN = 1e-6
#: Factor on the size of joint and base coordinates, and on that of others, in the choice of the
#: dependent ones: as joints move without force, a mode is chosen only if they hardly move a row.
_FIRST = 1e6
#: Singular value of the Jacobian over the largest, below which rows depend on each other. It
#: decreases in proportion to the distance from such a posture, in rad.
_DEPENDENT = 1e-8
#: Motion of a dependent coordinate with an independent one that is rounding error, in sizes.
_NOTHING = 1e-13
#: Most Newton steps that close a posture, largest change in one (rad, or of the reach), and gap
#: that counts as zero after rounding.
_ROUNDS, _LARGEST, _ROUNDING = 200, 0.3, 1e-13
#: Gap up to which `assembled` counts the loops as closed.
_CLOSED = 1e-9
#: Gap below which a sequence that no longer decreases has reached its rounding errors.
_STAGNANT = 1e-10
#: Newton steps without progress before the search ends.
_PATIENCE = 20


class Motions(NamedTuple):
    """Small motions that keep the loops closed; without closures, all of the free coordinates.

    ``independent`` (k,) and ``dependent`` (rows,): indices of coordinates. ``basis`` (dof, k): Z,
    with ones in the independent coordinates; None without closures. ``solver`` (rows, rows): the
    inverse of the columns of J of the dependent coordinates.
    """

    dof: int
    independent: IntArray
    dependent: IntArray
    basis: FloatArray | None
    solver: FloatArray

    def forces(self, force: FloatArray) -> FloatArray:
        """Return the forces (k, ...) on independent coordinates of forces (dof, ...)."""
        return force[self.independent] if self.basis is None else self.basis.T @ force

    def matrix(self, matrix: FloatArray) -> FloatArray:
        """Return Z' A Z (k, k) of a matrix A (dof, dof)."""
        if self.basis is None:
            return matrix[np.ix_(self.independent, self.independent)]
        return np.asarray(self.basis.T @ matrix @ self.basis)

    def displacements(self, moved: NDArray[Any]) -> NDArray[Any]:
        """Return displacements (dof, ...) of those in independent coordinates (k, ...)."""
        if self.basis is not None:
            return np.asarray(self.basis @ moved)
        spread = np.zeros((self.dof, *moved.shape[1:]), dtype=moved.dtype)
        spread[self.independent] = moved
        return spread

    def multipliers(self, force: FloatArray) -> FloatArray:
        """Return the closure forces (rows,) that take the forces on dependent coordinates."""
        return np.asarray(self.solver.T @ force[self.dependent])

    def closed(self, arm: Arm, q: FloatArray) -> FloatArray:
        """Return q near that of this motion, with dependent coordinates that close the loops."""
        if self.basis is None:
            return q
        q, sizes, before = q.copy(), row_sizes(arm), np.inf
        for _ in range(_ROUNDS):
            gaps = arm.closure_gaps(q)
            size = float(np.max(np.abs(gaps / sizes)))
            if size <= _ROUNDING or (size >= 0.5 * before and size < _STAGNANT):
                return q
            if not size < 10.0 * before:
                break
            before = size
            q[self.dependent] -= self.solver @ gaps
        raise np.linalg.LinAlgError("the loops do not close")


@once_per_arm
def row_sizes(arm: Arm) -> FloatArray:
    """Return gaps (rows,) of equal size: the reach, and one radian for angles."""
    turns = arm.assembly.constants.ends[:, 0] == ROW_ANGLE
    return np.where(turns, 1.0, arm.reach)


def _closures_of(arm: Arm, rows: Sequence[int] | NDArray[np.intp]) -> str:
    """Return the names of the closures to which rows belong."""
    numbers = sorted({arm.closure_numbers[row] for row in rows})
    return ", ".join(f"arm.closures[{number - 1}]" for number in numbers)


def _rigid_coordinates(arm: Arm) -> IntArray:
    """Return the indices in q of the joints and of the base."""
    base = [coordinate.place for coordinate in arm.assembly.base]
    return np.array(sorted([*base, *arm.joint_index.tolist()]), dtype=np.intp)


@once_per_arm
def _ease(arm: Arm) -> FloatArray:
    """Return how far equal forces move the coordinates (dof,), compared to their sizes, at most 1.

    Relative to the softest mode; joints and the base move by ``_FIRST`` of it.
    """
    constants = arm.assembly.constants
    springs = np.concatenate([constants.joint_stiffness[:, None], constants.w2], axis=1)
    stiffness = arm.unpadded(springs) * coordinate_sizes(arm) ** 2
    rigid = _rigid_coordinates(arm)
    elastic = np.setdiff1d(np.arange(arm.dof), rigid)
    ease = np.ones(arm.dof)
    positive = stiffness[elastic][stiffness[elastic] > 0.0]
    softest = float(positive.min()) if positive.size else 1.0
    ease[elastic] = np.sqrt(softest / np.maximum(stiffness[elastic], softest)) / _FIRST
    return ease


def independent_motions(
    arm: Arm, q: FloatArray, free: IntArray, preferred: IntArray | None = None
) -> Motions:
    """Return the motions of the coordinates ``free`` that keep the loops closed at q (dof,).

    The dependent coordinates are joints and the base as far as they move the rows: columns of J,
    chosen by factorisation with pivoting. The ``preferred`` of them are dependent only if the
    others do not suffice; modes only if joints are locked, or if there are too few of them, and
    then the softest ones.
    """
    if not arm.closure_rows:
        nothing = np.zeros(0, dtype=np.intp)
        return Motions(arm.dof, free, nothing, None, np.zeros((0, 0)))
    J = arm.closure_jacobian(q)
    scaled = _scaled(arm, J)[:, free]
    _refuse_dependent(arm, scaled)
    ease = _ease(arm).copy()
    if preferred is not None:
        ease[preferred] /= _FIRST**0.5
    order = linalg.qr(scaled * ease[free], mode="r", pivoting=True)[1]
    dependent = free[np.sort(order[: len(J)])]
    return motions_of(arm, J, np.setdiff1d(free, dependent), dependent)


def motions_of(arm: Arm, J: FloatArray, independent: IntArray, dependent: IntArray) -> Motions:
    """Return the motions of given coordinates that keep the loops with a Jacobian J closed."""
    sizes = coordinate_sizes(arm)
    solver = np.asarray(np.linalg.inv(J[:, dependent]), dtype=np.float64)
    basis = np.zeros((arm.dof, independent.size))
    basis[independent, np.arange(independent.size)] = 1.0
    follow = -solver @ J[:, independent]
    # Rounding errors would give stiff modes a part in motions that do not bend the links.
    follow[np.abs(follow) * sizes[independent] < _NOTHING * sizes[dependent, None]] = 0.0
    basis[dependent] = follow
    return Motions(arm.dof, independent, dependent, basis, solver)


def _refuse_dependent(arm: Arm, scaled: FloatArray) -> None:
    """Raise if rows of a scaled Jacobian (rows, k) depend on each other."""
    values = np.linalg.svd(scaled, compute_uv=False) if scaled.size else np.zeros(1)
    rank = int(np.count_nonzero(values > _DEPENDENT * values.max()))
    if rank == len(scaled):
        return
    surplus = np.arange(len(scaled))
    if rank:
        surplus = linalg.qr(scaled.T, mode="r", pivoting=True)[1][rank:]
    rule = "depends on the other closures, or on nothing that can move, in this posture"
    hint = (
        "Let more joints move. A straight link does not stretch: a point on its axis that cannot "
        "move along it needs kind='line'."
    )
    raise InputError(Problem(_closures_of(arm, surplus), rule, hint=hint))


#: How to find a closed posture.
_POSTURE = "fa.assembled(arm, q) computes a posture near q that closes them."


def refuse_open(arm: Arm, name: str, q: FloatArray, hint: str = _POSTURE) -> None:
    """Raise if the posture q (dof,), an argument ``name``, does not close the loops."""
    if arm.closure_rows:
        gaps = arm.closure_gaps(q)
        largest = int(np.argmax(np.abs(gaps / row_sizes(arm))))
        if abs(gaps[largest]) > _OPEN * row_sizes(arm)[largest]:
            raise InputError(Problem(name, "close the loops", _gap(arm, gaps, largest), hint))


def refuse_opening(
    arm: Arm, names: tuple[str, str], q: FloatArray, qd: FloatArray, free: list[int] | None = None
) -> None:
    """Raise unless loops are closed at q (dof,), and rates qd, of these ``names``, keep them so.

    Also if rows of closures depend on each other for the coordinates ``free``.
    """
    if arm.closure_rows:
        refuse_open(arm, names[0], q)
        J = _scaled(arm, arm.closure_jacobian(q))
        _refuse_rates(arm, names[1], J, qd, "fa.assembled(arm, q, qd) computes both.")
        if free is not None:
            _refuse_dependent(arm, J[:, free])


def refuse_jamming(arm: Arm, q: FloatArray, driven: Sequence[int] = ()) -> None:
    """Raise if friction can hold more joints at q (dof,) than the loops leave free to move.

    The torques of such joints at rest depend on each other, so that the run has no solution.
    ``driven`` are the coordinates of joints with a prescribed motion, which friction cannot stop.
    """
    assembly = arm.assembly
    holds = assembly.constants.holds[assembly.joint_body] * assembly.breakaway > 0.0
    holds &= ~np.isin(arm.joint_index, driven)
    if not arm.closure_rows or np.count_nonzero(holds) < 2:
        return
    J = _scaled(arm, arm.closure_jacobian(q))
    most = np.abs(J).max() * _DEPENDENT
    twists = [seat.twist for seat in assembly.seats if seat.twist is not None]
    moving = np.setdiff1d(np.union1d(_rigid_coordinates(arm), twists), driven).astype(np.intp)
    rest = np.setdiff1d(moving, arm.joint_index[holds])
    every, left = (int(np.linalg.matrix_rank(J[:, k], tol=most)) for k in (moving, rest))
    if left < every:
        name = ", ".join(f"arm.joints[{seat.link}]" for seat in compress(assembly.seats, holds))
        rule = "holds more joints of a loop at rest than the loop leaves free"
        hint = "Let fewer of them hold, or give them a smoothing_rate, with which they creep."
        raise InputError(Problem(f"friction of {name}", rule, hint=hint))


def _refuse_rates(arm: Arm, name: str, J: FloatArray, qd: FloatArray, hint: str) -> None:
    rates = qd / coordinate_sizes(arm)
    left, scale = np.abs(J @ rates), np.max(np.abs(J) @ np.abs(rates))
    worst = int(np.argmax(left))
    if left[worst] > _OPEN * scale:
        speed = left[worst] * row_sizes(arm)[worst]
        unit = "rad/s" if arm.assembly.constants.ends[worst, 0] == ROW_ANGLE else "m/s"
        value = f"a gap that opens by {speed:.3g} {unit} at {_closures_of(arm, [worst])}"
        raise InputError(Problem(name, "keep the loops closed", value, hint))


def _gap(arm: Arm, gaps: FloatArray, row: int) -> str:
    unit = "rad" if arm.assembly.constants.ends[row, 0] == ROW_ANGLE else "m"
    return f"a gap of {abs(gaps[row]):.3g} {unit} at {_closures_of(arm, [row])}"


def stiffness_of(
    arm: Arm,
    q: FloatArray,
    forces: FloatArray,
    loads: Sequence[Load] = (),
    contacts: Sequence[Contact] = (),
) -> FloatArray:
    """Return `Arm.stiffness_matrix` (dof, dof) less the curvature of closures with ``forces``."""
    if not forces.size:
        return arm.stiffness_matrix(q, loads=loads, contacts=contacts)
    placed = Environment(loads, None, contacts).placed(arm)
    return arm._hessian(arm._state(q, None), placed, forces)


def least_forces(arm: Arm, q: FloatArray, force: FloatArray, free: IntArray) -> FloatArray:
    """Return the closure forces (rows,) that leave the least of a ``force`` (dof,) at q.

    Forces on the coordinates ``free`` count by the displacements that they cause, so that the
    forces of closures are those of the equilibrium close to q.
    """
    J = arm.closure_jacobian(q)
    weight = (_ease(arm) * coordinate_sizes(arm))[free]
    rows = row_sizes(arm)
    matrix = (J[:, free] * weight / rows[:, None]).T
    return np.asarray(np.linalg.lstsq(matrix, weight * force[free], rcond=None)[0] / rows)


def sized_gaps(arm: Arm, constants: ArmConstants, state: FloatArray) -> FloatArray:
    """Return gaps and their rates (rows, 2) of equal size, with other numbers of the arm.

    Rates are relative to the largest rate of the state, if there is one.
    """
    kernels = KernelView(constants)
    kernels.call(closure_gaps, state, kernels.work)
    speed = float(np.max(np.abs(state[1]))) or 1.0
    return kernels.work.closure[:, [GAP, GAP_RATE]] / row_sizes(arm)[:, None] / [1.0, speed]


def by_independent(arm: Arm, state: FloatArray, slope: FloatArray) -> FloatArray:
    """Return the derivatives (2, dof) of a function of q and qd, along the closures.

    ``slope`` (2, dof) are those without closures, at a ``state`` (2, dof). Dependent coordinates
    and rates follow the independent ones; derivatives by them are zero. Theory page "mechanisms",
    (M.29).
    """
    motions = independent_motions(arm, state[0], np.arange(arm.dof))
    if motions.basis is None:
        return slope
    by_q, by_qd = slope
    # The rates keep J qd = 0 while q moves.
    by_q = by_q - by_qd[motions.dependent] @ motions.solver @ gaps_by_q(arm, state, GAP_RATE)
    along = np.zeros_like(slope)
    along[:, motions.independent] = motions.forces(by_q), motions.forces(by_qd)
    return along


def gap_bias(arm: Arm, q: FloatArray, qd: FloatArray) -> FloatArray:
    """Return the second derivatives of the gaps (rows,) at q and qd without accelerations."""
    kernels = KernelView(arm.assembly.constants, complex)
    state = arm.padded(np.stack([q + 1j * STEP * qd, qd]))
    kernels.call(closure_gaps, state, kernels.work)
    return np.asarray(kernels.work.closure[:, GAP_RATE].imag / STEP)


def held_joints(arm: Arm, held: Sequence[int], name: str = "held") -> IntArray:
    """Return the indices in q of the joints whose numbers an argument ``name`` lists."""
    numbers = held.tolist() if isinstance(held, np.ndarray) else as_list(held)
    if not isinstance(numbers, list):
        raise InputError(Problem(name, "be a list of numbers of joints", shown(held)))
    places = [check_joint(arm, name, number) for number in numbers]
    return arm.joint_index[np.array(places, dtype=np.intp)]


class AssembledState(NamedTuple):
    """A state that closes the loops of a mechanism.

    Attributes:
        q: (dof,) coordinates.
        qd: (dof,) rates.
        gap: (closure_rows,) what is left of `Arm.closure_gaps`, m and rad.
        mobility: coordinates of joints and base less equations of the closures (Grübler).
        freedom: the same, with the number of independent equations in this posture: motions of the
            rigid mechanism.
    """

    q: FloatArray
    qd: FloatArray
    gap: FloatArray
    mobility: int
    freedom: int


@public_call
def assembled(
    arm: Arm, q: ArrayLike, qd: ArrayLike | None = None, *, held: Sequence[int] = ()
) -> AssembledState:
    """Compute a posture near a guess that closes the loops of a mechanism, and rates to match.

    Args:
        arm: the mechanism.
        q: (dof,) guess, such as ``arm.rest(joint_angles)``.
        qd: (dof,) rates; zero by default. Those of the joints and of the base change as little as
            possible.
        held: numbers of the joints whose angles, and rates, stay.

    Raises:
        InputError: if an argument has the wrong shape, ``held`` is not the numbers of joints that
            can move, or the loops do not close.

    Newton's method on joints and base, with the least change in each step and steps of at most
    0.3 rad, so that a closed posture in the vicinity of the guess is found. Links bend only if
    joints and base do not suffice, as with an additional crank of another length.
    """
    q = check_array("q", q, (arm.dof,)).copy()
    qd = np.zeros(arm.dof) if qd is None else check_array("qd", qd, (arm.dof,)).copy()
    fixed = held_joints(arm, held)
    rigid = _rigid_coordinates(arm)
    mobility = rigid.size - arm.closure_rows
    if not arm.closure_rows:
        return AssembledState(q, qd, np.zeros(0), mobility, mobility)
    q, movable = closed_posture(arm, q, fixed)
    J = _scaled(arm, arm.closure_jacobian(q))
    sizes, ease = coordinate_sizes(arm), np.minimum(_FIRST * _ease(arm)[movable], 1.0)
    to_rates = ease[:, None] * np.linalg.pinv(J[:, movable] * ease, rcond=_DEPENDENT)
    qd[movable] -= sizes[movable] * (to_rates @ (J @ (qd / sizes)))
    _refuse_rates(arm, "qd", J, qd, "Hold fewer joints.")
    scaled, freedom = J[:, rigid], rigid.size
    if scaled.size:
        freedom -= int(np.linalg.matrix_rank(scaled, tol=_DEPENDENT))
    return AssembledState(q, qd, arm.closure_gaps(q), mobility, freedom)


def closed_posture(arm: Arm, q: FloatArray, fixed: IntArray) -> tuple[FloatArray, IntArray]:
    """Return q (dof,) near a guess, with closed loops, and the indices of what moved for that.

    Raises:
        InputError: if the loops do not close without the coordinates ``fixed``.
    """
    rigid, guess, q = _rigid_coordinates(arm), q, q.copy()
    movable = np.setdiff1d(rigid, fixed)
    if not _close(arm, q, movable) <= _CLOSED:
        if fixed.size and _close(arm, guess.copy(), rigid) <= _CLOSED:
            raise _remaining(arm, q, "Hold fewer joints, or at other angles.")
        bent = q.copy()
        movable = np.union1d(movable, np.setdiff1d(np.arange(arm.dof), rigid))
        if not _close(arm, bent, movable) <= _CLOSED or bending_warning(arm, bent):
            raise _remaining(arm, q, "Check the lengths, or start from a posture that is closer.")
        q = bent
    return q, movable


def _remaining(arm: Arm, q: FloatArray, hint: str) -> InputError:
    """Return the error that the joints leave a gap at q."""
    gaps = arm.closure_gaps(q)
    gap = _gap(arm, gaps, int(np.argmax(np.abs(gaps / row_sizes(arm)))))
    return InputError(Problem("the loops", f"cannot be closed: {gap} is left", hint=hint))


def _scaled(arm: Arm, J: FloatArray) -> FloatArray:
    """Return a Jacobian J (rows, dof) of rows and coordinates of equal size."""
    return np.asarray(J * coordinate_sizes(arm) / row_sizes(arm)[:, None])


def _close(arm: Arm, q: FloatArray, movable: IntArray) -> float:
    """Change q in the coordinates ``movable`` until the loops close; return the remaining gap."""
    sizes, rows = coordinate_sizes(arm)[movable], row_sizes(arm)
    ease = np.minimum(_FIRST * _ease(arm)[movable], 1.0)
    best, reached, stalled = np.inf, q.copy(), 0
    for _ in range(_ROUNDS):
        gaps = arm.closure_gaps(q) / rows
        size = float(np.max(np.abs(gaps)))
        # Steps of limited length may pass postures with larger gaps.
        stalled = 0 if size < 0.99 * best else stalled + 1
        if size < best:
            best, reached = size, q.copy()
        if size <= _ROUNDING or stalled > _PATIENCE or not movable.size:
            break
        J = _scaled(arm, arm.closure_jacobian(q))[:, movable]
        step = -ease * (np.linalg.pinv(J * ease, rcond=_DEPENDENT) @ gaps)
        step *= min(1.0, _LARGEST / max(float(np.max(np.abs(step))), 1e-300))
        q[movable] += sizes * step
    q[:] = reached
    return best
