"""Paths of rigid mechanisms: the tip or some joints are given, the other joints close the loops.

With the Jacobian ``J`` of the closures, and of the tip if it is given, the joints follow from

    r(q) = p(s),    J dq/ds = dp/ds,    J d2q/ds2 = d2p/ds2 - (dJ/ds) dq/ds,

theory page "mechanisms", (M.23). Newton's method solves the first equation from the posture
before, so that the working mode is kept. Polynomials of degree 5 connect the postures.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray, IntArray
from flexarm.arm.assembly.coordinates import coordinate_sizes, turning_joints
from flexarm.arm.closed import closed_posture, gap_bias, row_sizes
from flexarm.base.arguments import check_posture
from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.late import interpolate
from flexarm.model import Closure
from flexarm.model.arm.spec import FREE_BASE, serial_only
from flexarm.motion.dynamics.following_base import FollowingBase

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

#: Least singular value of J with respect to the joints that follow, in sizes: about the distance
#: from a singular posture, in rad.
_SINGULAR = 1e-4
#: Newton's steps from one posture to the next, the gap that counts as closed, and the largest
#: distance from the expected posture, beyond which another working mode may begin.
_STEPS, _CLOSED, _FAR = 12, 1e-9, 0.05
#: Shortest interval.
_SHORTEST = 1e-6
#: First number of intervals, largest number, and error of d2q/ds2 that is accepted, over its
#: largest value. Halving the intervals divides the error by 16.
_FIRST, _MOST, _ERROR = 16, 2**14, 1e-8


class Given(NamedTuple):
    """Given values (k,) along a path, and two derivatives by s."""

    value: FloatArray
    slope: FloatArray
    curve: FloatArray


class _Singular(Exception):
    """The joints that follow are not determined by the given ones."""


class _Equations:
    """Equations of a rigid mechanism with given joints, and with a given tip after ``start``."""

    def __init__(self, arm: Arm, guess: Any, driven: IntArray, start: FloatArray | None) -> None:
        # The gap of a tip that is pinned to the start is its distance along the path.
        rigid = arm.rigid() if start is None else _pinned(arm, start)
        self.arm = rigid
        self.driven = driven
        self.following = np.setdiff1d(np.arange(rigid.dof), self.driven)
        self.sizes, self.rows = coordinate_sizes(rigid)[self.following], row_sizes(rigid)
        self.origin = np.zeros(2) if start is None else start
        if start is None:
            self.start, _ = closed_posture(rigid, rigid.rest(guess), driven)
        else:
            self.start = posture_near(arm, start, guess)

    def at(self, near: FloatArray, gaps: Given, joints: Given) -> FloatArray:
        """Return the posture near another one, and two derivatives by s, (3, joints)."""
        q = near.copy()
        q[self.driven] = joints.value
        left = before = np.inf
        for _ in range(_STEPS):
            J, inverse = self._solver(q)
            gap = self.arm.closure_gaps(q) - gaps.value
            left = float(np.max(np.abs(gap / self.rows)))
            if left == 0.0 or (left <= _CLOSED and left >= 0.1 * before):
                break
            q[self.following] -= inverse @ gap
            before = left
        moved = np.abs(q - near)[self.following] / self.sizes
        if not left <= _CLOSED or np.max(moved, initial=0.0) > _FAR:
            raise _Singular
        slope, curve = np.zeros_like(q), np.zeros_like(q)
        slope[self.driven], curve[self.driven] = joints.slope, joints.curve
        slope[self.following] = inverse @ (gaps.slope - J @ slope)
        bias = gaps.curve - gap_bias(self.arm, q, slope)
        curve[self.following] = inverse @ (bias - J @ curve)
        return np.stack([q, slope, curve])

    def _solver(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return J (rows, joints) and the motion of the following joints by gaps."""
        J = self.arm.closure_jacobian(q)
        scaled = J[:, self.following] * self.sizes / self.rows[:, None]
        left, values, right = np.linalg.svd(scaled, full_matrices=False)
        if len(values) < self.following.size or values[-1] < _SINGULAR:
            raise _Singular
        inverse = (right.T / values) @ left.T
        return J, np.asarray(self.sizes[:, None] * inverse / self.rows)


def _pinned(arm: Arm, point: FloatArray) -> Arm:
    """Return the rigid model of an arm with the tip pinned to a point (2,) of the ground."""
    spec = arm.rigid().spec
    pin = Closure(link=arm.n_links, to_offset=tuple(point.tolist()))
    return Arm(spec.replace(closures=[*spec.closures, pin]))


def posture_near(arm: Arm, point: FloatArray, posture: ArrayLike | None) -> FloatArray:
    """Return joint angles (joints,) of a rigid mechanism near a posture, with a given tip (2,)."""
    serial_only(arm.spec, "inverse kinematics of the tip", ("a free base",))
    if posture is None:
        hint = "Give joint angles near those at the point."
        raise InputError(Problem("posture", "is required for this arm", hint=hint))
    guess = check_posture("posture", posture, arm.n_joints, turning_joints(arm))
    pinned = _pinned(arm, point)
    try:
        return closed_posture(pinned, pinned.rest(guess), np.zeros(0, dtype=np.intp))[0]
    except InputError:
        hint = "Check the point, or start from a posture that is closer."
        value = f"({point[0]:.6g}, {point[1]:.6g})"
        problem = Problem(
            "the tip", f"does not reach the point {value} near the posture", hint=hint
        )
        raise InputError(problem) from None


def mechanism_path(
    arm: Arm,
    guess: Any,
    driven: IntArray,
    joints: Callable[[float], Given],
    tip: Callable[[float], Given] | None = None,
    breaks: Sequence[float] = (),
) -> interpolate.PPoly:
    """Return the joint angles of a rigid mechanism as polynomials of s, from 0 to 1.

    Args:
        guess: joint angles (joints,) near the posture at the start, validated if a tip is given.
        driven: indices of the joints that are given.
        joints: their values at s.
        tip: points at s, world axes; None if the tip is not given.
        breaks: s between 0 and 1 at which a third derivative may jump.

    Raises:
        InputError: if the given values do not determine the other joints, or if the path reaches a
            singular posture.
    """
    if tip is not None:
        serial_only(arm.spec, "a motion of the tip", FREE_BASE)
    if tip is None and arm.assembly.base and arm.closure_rows:
        arm = FollowingBase(arm.rigid()).fixed
    if tip is None and not arm.closure_rows:
        raise InputError(Problem("driven", "is not supported for an arm without closures"))
    start = None if tip is None else tip(0.0).value
    equations = _Equations(arm, guess, driven, start)

    def posture(s: float, near: FloatArray) -> FloatArray:
        gaps = Given(*np.zeros((3, len(equations.rows))))
        if tip is not None:
            for filled, part in zip(gaps, tip(s), strict=True):
                filled[-2:] = part
            gaps.value[-2:] -= equations.origin
        return equations.at(near, gaps, joints(s))

    try:
        first = posture(0.0, equations.start)
    except _Singular:
        numbers = arm.joint_numbers[driven].tolist()
        rule = "determine the other joints of the mechanism"
        hint = "Give as many joints as fa.assembled(arm, q).freedom, and no singular posture."
        problem = Problem("driven", rule, shown(numbers), hint)
        if tip is not None:
            rule = "has joints that the position of the tip does not determine"
            problem = Problem("arm", rule, hint="Use fa.joint_motion.")
        raise InputError(problem) from None
    return _table(np.array([0.0, *breaks, 1.0]), first, posture)


def _table(
    edges: FloatArray, first: FloatArray, posture: Callable[[float, FloatArray], FloatArray]
) -> interpolate.PPoly:
    """Return polynomials through postures (3, joints), which are close enough to each other."""
    s, states = _first_states(edges, first, posture)
    while True:
        table = interpolate.PPoly(quintics(states[:-1], states[1:], np.diff(s)), s)
        middle = 0.5 * (s[:-1] + s[1:])
        near = table(middle)
        try:
            between = np.array([posture(*pair) for pair in zip(middle.tolist(), near, strict=True)])
        except _Singular:
            raise _singular(middle[0], near[0]) from None
        error = np.abs(table(middle, 2) - between[:, 2]).max(axis=1)
        s = np.insert(s, range(1, len(s)), middle)
        states = np.insert(states, range(1, len(states)), between, axis=0)
        # The intervals are halved once more, which divides the error by 16.
        if error.max() <= 16.0 * _ERROR * np.abs(states[:, 1:]).max():
            return interpolate.PPoly(quintics(states[:-1], states[1:], np.diff(s)), s)
        if len(s) > _MOST:
            raise _singular(middle[error.argmax()], near[error.argmax()])


def _first_states(
    edges: FloatArray, first: FloatArray, posture: Callable[[float, FloatArray], FloatArray]
) -> tuple[FloatArray, FloatArray]:
    """Return s (k,) and postures (k, 3, joints) that follow from each other."""
    places, states = [0.0], [first]
    for a, b in pairwise(edges):
        h = (b - a) / _FIRST
        while places[-1] < b:
            s, (q, slope, curve) = places[-1], states[-1]
            # The last interval ends at b, in spite of rounding.
            step = b - s if b - s < 1.5 * h else h
            try:
                states.append(posture(s + step, q + step * slope + 0.5 * step**2 * curve))
            except _Singular:
                h = 0.5 * step
                if h < _SHORTEST:
                    raise _singular(s, q) from None
                continue
            places.append(b if step == b - s else s + step)
            h = min(2.0 * h, (b - a) / _FIRST)
    return np.array(places), np.array(states)


def _singular(s: float, q: FloatArray) -> InputError:
    rule = (
        f"cannot be followed by the other joints beyond {100.0 * s:.3g} % of its path, at the "
        f"joint angles {shown(np.round(q, 4).tolist())}"
    )
    return InputError(Problem("motion", rule, hint="Choose a path farther from singular postures."))


def quintics(first: Any, last: Any, width: FloatArray) -> FloatArray:
    """Return Hermite polynomials (6, k, n) of falling powers of the distance from the start.

    ``first`` and ``last`` are values and two derivatives, (k, n) each, at both ends of intervals
    of ``width`` (k,): as three arrays, or as the second axis of one.
    """
    first, last = (np.moveaxis(x, 1, 0) if isinstance(x, np.ndarray) else x for x in (first, last))
    h = width[:, None]
    q, v, a = first[0], h * first[1], 0.5 * h**2 * first[2]
    # Values at the end minus those of the parabola given by the start.
    value = last[0] - (q + v + a)
    slope = h * last[1] - (v + 2.0 * a)
    bend = 0.5 * h**2 * last[2] - a
    rows = [
        (6.0 * value - 3.0 * slope + bend) / h**5,
        (-15.0 * value + 7.0 * slope - 2.0 * bend) / h**4,
        (10.0 * value - 4.0 * slope + bend) / h**3,
        0.5 * first[2],
        first[1],
        q,
    ]
    return np.stack(rows)


def quintic_table(edges: FloatArray, first: Any, last: Any, rests: FloatArray) -> interpolate.PPoly:
    """Return polynomials of degree 5 between rest before and rest after a motion.

    ``first`` and ``last`` (k, n) are values at the start and at the end of each interval between
    the edges (k + 1,) s, ``rests`` (2, n) rad the angles before and after the motion.
    """
    constant = np.zeros((2, 6, rests.shape[1]))
    constant[:, 5] = rests
    inner = quintics(first, last, np.diff(edges)).transpose(1, 0, 2)
    coefficients = np.concatenate([constant[:1], inner, constant[1:]]).transpose(1, 0, 2)
    ends = np.concatenate([[edges[0] - 1.0], edges, [edges[-1] + 1.0]])
    return interpolate.PPoly(np.ascontiguousarray(coefficients), ends)
