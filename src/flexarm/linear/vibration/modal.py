"""Natural frequencies and mode shapes of an arm at an equilibrium."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.actions import Environment, marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import check_state
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.closed import (
    Motions,
    independent_motions,
    least_forces,
    refuse_open,
    stiffness_of,
)
from flexarm.arm.stations import MOST_STATIONS
from flexarm.base.arguments import as_list, check_count, check_number
from flexarm.base.errors import (
    InputError,
    Problem,
    check_array,
    check_result,
    few,
    public_call,
    shown,
)
from flexarm.base.late import linalg, optimize
from flexarm.base.notebook import html_table
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.observation.shapes import axis_points
from flexarm.linear.statics.axial import warn_of_theory
from flexarm.linear.statics.equilibrium import (
    Equilibrium,
    Tangent,
    steady_rates,
    steady_shape,
    tangent,
)
from flexarm.linear.statics.gaps import warn_of_backlash, warn_of_bristles, warn_of_sticking
from flexarm.model import Load
from flexarm.model.quantities import Flag, Number

JOINTS = ("locked", "free")
_RULE = "be 'locked', 'free' or [proportional, derivative] (N m/rad, N m s/rad) for each joint"


class Gains(Protocol):
    """Feedback gains of every joint, such as a `JointPD`: (joints,) N m/rad and N m s/rad."""

    @property
    def proportional(self) -> ArrayLike: ...

    @property
    def derivative(self) -> ArrayLike: ...


OneJoint = str | tuple[float, float]
Joints = str | Sequence[OneJoint] | Gains


class JointFeedback(NamedTuple):
    """Coordinates that can move, and stiffness and damping of the feedback, each (dof,)."""

    moving: NDArray[np.intp]
    stiffness: FloatArray
    damping: FloatArray


def joint_feedback(arm: Arm, joints: Joints) -> JointFeedback:
    """Convert the argument ``joints`` of `modes` to coordinates and gains."""
    stiffness, damping = np.zeros(arm.dof), np.zeros(arm.dof)
    index = arm.joint_index
    moving = np.ones(arm.dof, dtype=bool)
    if isinstance(joints, type):
        raise _unknown("joints", joints)
    if hasattr(joints, "proportional") and hasattr(joints, "derivative"):
        count = (arm.n_joints,)
        stiffness[index] = check_array("joints.proportional", joints.proportional, count)
        damping[index] = check_array("joints.derivative", joints.derivative, count)
        return JointFeedback(np.arange(arm.dof), stiffness, damping)
    if isinstance(joints, str):
        each: list[OneJoint] = [joints] * arm.n_joints
        if joints not in JOINTS:  # checked for an arm without joints, too
            raise _unknown("joints", joints)
    else:
        listed = as_list(joints)
        each = listed or []
        if listed is None or len(each) != arm.n_joints:
            rule = "be 'locked', 'free', or a list with one of these, or with gains, for each of"
            raise InputError(Problem("joints", f"{rule} the {arm.n_joints} joints", shown(joints)))
    for place, item in zip(index, each, strict=True):
        if isinstance(item, str):
            if item not in JOINTS:
                raise _unknown("joints", item)
            moving[place] = item == "free"
        else:
            if len(as_list(item) or ()) != 2:
                raise InputError(Problem("joints", _RULE, shown(item)))
            stiffness[place], damping[place] = check_array("joints", item, (2,))
    return JointFeedback(np.flatnonzero(moving), stiffness, damping)


def _unknown(name: str, value: object) -> InputError:
    rule = "be one of " + ", ".join(map(repr, JOINTS)) + " or gains (N m/rad, N m s/rad)"
    return InputError(Problem(name, rule, shown(value)))


@dataclass(frozen=True, eq=False)
class Modes:
    """Modes of small vibration, in the order of ascending frequency.

    Attributes:
        frequency_hz: (k,) natural frequencies: undamped at rest; for a spinning arm the moduli of
            the eigenvalues over 2 pi. Zero for rigid-body modes, and for modes that gravity or spin
            makes unstable (``squared_frequency`` is negative there).
        damping_ratio: (k,) -Re / modulus of the eigenvalues; above one if a mode does not
            oscillate; NaN if the frequency is zero.
        squared_frequency: (k,) eigenvalues of stiffness over mass, rad^2/s^2.
        shapes: (k, dof) undamped shapes in the arm's coordinates, unit modal mass.
        eigenvalues: (k,) of the damped motion, 1/s, with nonnegative imaginary part; the other one
            of a pair is the conjugate. For a mode that does not oscillate, the slower of two.
        complex_shapes: (k, dof) shapes of the damped motion; imaginary parts are out of phase.
        q: (dof,) state of the linearisation. spin: rate of the whole arm, rad/s.
    """

    frequency_hz: FloatArray
    damping_ratio: FloatArray
    squared_frequency: FloatArray
    shapes: FloatArray
    eigenvalues: NDArray[Any]
    complex_shapes: NDArray[Any]
    q: FloatArray
    spin: float
    arm: Arm = field(repr=False)

    def __repr__(self) -> str:
        about = f", spinning at {self.spin:g} rad/s" if self.spin else ""
        frequencies = f": {few(self.frequency_hz)} Hz" if self.frequency_hz.size else ""
        return f"<flexarm.Modes: {self.frequency_hz.size}{about}{frequencies}>"

    def _repr_html_(self) -> str:
        heads = ("mode", "frequency (Hz)", "damping ratio")
        numbers = range(1, self.frequency_hz.size + 1)
        rows = zip(numbers, self.frequency_hz, self.damping_ratio, strict=True)
        return html_table(repr(self).strip("<>"), heads, rows)

    @property
    def damped_frequency_hz(self) -> FloatArray:
        """Frequencies (k,) of damped free vibration, imaginary parts of the eigenvalues, Hz."""
        return np.asarray(np.abs(self.eigenvalues.imag) / (2.0 * np.pi))

    @public_call
    def displacements(self, stations: int = 50, damped: Flag = False) -> NDArray[Any]:
        """Return displacements of the axis for unit modal amplitude, (k, links, stations, 2) m.

        World axes. ``damped`` selects ``complex_shapes``: multiply by exp(i phase).
        """
        shapes = self.complex_shapes if damped else self.shapes
        count = check_count("stations", stations, 2, MOST_STATIONS)
        return _displacements(self.arm, self.q, shapes, count)

    @public_call
    def curves(self, stations: int = 50, amplitude: float | None = None) -> FloatArray:
        """Return the mode shapes as curves in the world frame, (k, links, stations, 2) m.

        The shape of the arm at ``q`` plus displacements; the largest displacement of each mode is
        ``amplitude`` (m), by default a tenth of the arm's length.

        Raises:
            InputError: if ``amplitude`` is not a finite number, or there are fewer than two
                stations.
        """
        size = 0.1 * self.arm.reach if amplitude is None else check_number("amplitude", amplitude)
        moved = self.displacements(check_count("stations", stations, 2, MOST_STATIONS))
        largest = np.linalg.norm(moved, axis=-1).max(axis=(1, 2), initial=0.0)
        factor = size / np.where(largest > 0.0, largest, 1.0)
        return np.asarray(self.arm.shape(self.q, stations) + factor[:, None, None, None] * moved)


@public_call
def modes(
    arm: Arm,
    joint_angles: ArrayLike | Equilibrium | None = None,
    joints: Joints = "locked",
    *,
    q: ArrayLike | Equilibrium | None = None,
    spin: Number = 0.0,
    tip_force: ArrayLike | None = None,
    loads: Sequence[Load] = (),
) -> Modes:
    """Compute the modes of an arm about a posture, a bent state, or a steady spin.

    Args:
        arm: the arm.
        joint_angles: (joints,) relative, rad, with straight links; all zero by default. Or q
            (dof,) of bent links, or an `Equilibrium`, with its loads and contacts.
        joints: "locked" clamps every joint, "free" lets every joint rotate. Or one entry per joint:
            one of these words, or feedback gains (proportional N m/rad, derivative N m s/rad). Or
            an object with gains for all joints, such as a `JointPD`.
        q: another name of ``joint_angles``.
        spin: rad/s of the whole arm about its base joint, in its steady bent shape; the first joint
            is driven at that rate, or free. Not supported with gravity, loads or contacts.
        tip_force, loads: as in `Arm.forward_dynamics`; they contribute to the stiffness. Not to be
            combined with an `Equilibrium`, which has its own.

    Raises:
        InputError: if ``joints`` is unknown, numbers have the wrong shape, ``spin`` is combined
            with gravity or loads, loads are combined with an equilibrium, the state does not close
            the loops of a mechanism, or a closure depends on the others while locked joints do not
            move.
        EquilibriumError: if the arm has no steady shape at that spin.

    Warns:
        LargeDeflectionWarning: a link is bent too far, or has too large an axial load, for the
            theory of the arm.
        FlexarmWarning: friction holds a free joint.

    The stiffness is that of small motion about the state, which is treated as an equilibrium. It
    includes the curvature of closures with the forces of the `Equilibrium`, or else with those that
    come closest to one without torques of free joints.
    Theory page "small motion", (S.2) to (S.5).
    """
    given = Environment.of(arm, tip_force, loads)
    given.placed(arm)  # errors name this function
    held = joint_feedback(arm, joints)
    place, environment = _place(arm, joint_angles, q, given)
    if spin != 0.0 and (environment.loads or environment.contacts):
        raise InputError(Problem("loads", "cannot be combined with spin"))
    point = joint_angles if q is None else q
    shape: tuple[int, ...] = np.shape(point)  # type: ignore[arg-type]
    bent = isinstance(q, Equilibrium) or shape == (arm.dof,) != (arm.n_joints,)
    if spin != 0.0 and not bent:
        place = steady_shape(arm, place, spin)
    refuse_open(arm, "joint_angles" if q is None else "q", place)
    motions = independent_motions(arm, place, held.moving)
    if isinstance(point, Equilibrium):
        closing = point.closure_forces
    else:
        closing = _closure_forces(arm, place, held, environment)
    small = _small_motion(arm, place, spin, environment, closing)
    solution = _solve(arm, place, spin, held, motions, small)
    warn_of_theory(arm, place, environment, steady_rates(arm, spin))
    warn_of_backlash(arm, place)
    warn_of_bristles(arm, "the model of the modes")
    rates = np.full(arm.dof, np.inf)  # of locked joints, whose friction has no effect
    rates[held.moving] = steady_rates(arm, spin)[held.moving]
    warn_of_sticking(arm, rates, "The model of the modes")
    return solution


def _place(
    arm: Arm,
    joint_angles: ArrayLike | Equilibrium | None,
    q: ArrayLike | Equilibrium | None,
    environment: Environment,
) -> tuple[FloatArray, Environment]:
    """Return q and the environment of the operating point."""
    if q is not None and joint_angles is not None:
        raise InputError(Problem("joint_angles", "cannot be combined with q"))
    given = joint_angles if isinstance(joint_angles, Equilibrium) else q
    if isinstance(given, Equilibrium):
        if environment.loads:
            rule = "cannot be combined with an equilibrium, which contains its own"
            raise InputError(Problem("loads", rule))
        return given.q, given.environment
    if q is not None:
        return check_state(arm, "q", q), environment
    angles = np.zeros(arm.n_joints) if joint_angles is None else joint_angles
    return check_state(arm, "joint_angles", angles), environment


def _closure_forces(
    arm: Arm, q: FloatArray, held: JointFeedback, environment: Environment
) -> FloatArray:
    """Return the closure forces (rows,) of a state that is treated as an equilibrium."""
    if not arm.closure_rows:
        return np.zeros(0)
    rest = np.zeros(arm.dof)
    loads, contacts = environment.loads, environment.contacts
    force = arm.inverse_dynamics(q, rest, rest, loads=loads, contacts=contacts)
    return least_forces(arm, q, force, held.moving)


def _small_motion(
    arm: Arm, q: FloatArray, spin: float, environment: Environment, closing: FloatArray
) -> Tangent:
    if spin == 0.0 and not environment.contacts and not arm.assembly.constants.has_joint_laws:
        # At rest the rates have an effect through constant dampers only, and K may be diagonal.
        K = stiffness_of(arm, q, closing, environment.loads)
        return Tangent(arm.mass_matrix(q), arm.damping_matrix(), K)
    rates = steady_rates(arm, spin)
    return tangent(arm, q, rates, np.zeros(arm.dof), environment, closing)


def _solve(
    arm: Arm, q: FloatArray, spin: float, held: JointFeedback, motions: Motions, small: Tangent
) -> Modes:
    M = motions.matrix(small.mass)
    try:
        linalg.cholesky(M)
    except np.linalg.LinAlgError:
        hint = "Divide the links into segments."
        rule = "bends links beyond the second-order theory: the mass matrix is indefinite"
        raise InputError(Problem("the state", rule, hint=hint)) from None
    K = motions.matrix(small.stiffness + np.diag(held.stiffness))
    D = motions.matrix(small.damping + np.diag(held.damping))
    squared, vectors = _undamped(M, (K + K.T) / 2.0)
    # Follower loads and centrifugal terms give a skew part; otherwise it is rounding.
    skew = (K - K.T) / 2.0
    lasting = np.abs(skew).max(initial=0.0) > 1e-12 * np.abs(K).max(initial=0.0)
    coupling = vectors.T @ skew @ vectors * lasting
    damping = vectors.T @ D @ vectors
    check_result(np.concatenate([squared[None], coupling, damping]), M, K, D)
    found = _damped(squared, coupling, damping)
    frequency = np.sqrt(np.maximum(squared, 0.0))
    if spin != 0.0:
        frequency = np.where(found.eigenvalues.imag > 0.0, np.abs(found.eigenvalues), 0.0)
    order = np.argsort(frequency, kind="stable")
    shapes = motions.displacements(vectors).T.copy()
    turning = motions.displacements(vectors @ found.vectors).T.astype(complex, order="C")
    ratio = np.where(frequency > 0.0, found.ratio, np.nan)
    return Modes(
        frequency_hz=frequency[order] / (2.0 * np.pi),
        damping_ratio=ratio[order] + 0.0,  # avoids negative zeros
        squared_frequency=squared[order],
        shapes=shapes[order],
        eigenvalues=found.eigenvalues[order],
        complex_shapes=turning[order],
        q=q,
        spin=spin,
        arm=arm,
    )


def _displacements(arm: Arm, q: FloatArray, shapes: NDArray[Any], stations: int) -> NDArray[Any]:
    """Return displacements (k, links, stations, 2) of the axis by ``shapes`` (k, dof), exactly."""
    places = [
        marker(number, x)
        for number, link in enumerate(arm.spec.links, start=1)
        for x in np.linspace(0.0, link.length, stations)
    ]
    placed = place_loads(arm, places)
    real = _along(arm, q, np.real(shapes), placed)
    moved = real + 1j * _along(arm, q, np.imag(shapes), placed) if np.iscomplexobj(shapes) else real
    return moved.reshape(len(shapes), arm.n_links, stations, 2)


def _along(arm: Arm, q: FloatArray, shapes: FloatArray, placed: Any) -> FloatArray:
    kernels = KernelView(arm.assembly.constants, complex)
    body_poses, tip = kernels.pose_arrays()
    points = np.zeros((len(shapes), len(placed.body), 2), dtype=complex)
    still = np.zeros(arm.dof)
    for shape, seen in zip(shapes, points, strict=True):
        state = arm.padded(np.stack([q + STEP * 1j * shape, still]))
        kernels.call(poses, state, body_poses, tip)
        points_at = placed.body, placed.lever, placed.rows, placed.shortening
        axis_points(kernels.sizes, state, body_poses, *points_at, seen)
    return np.asarray(points.imag / STEP)


#: Squared frequencies below this fraction of the shift are rounding errors of rigid-body modes.
_ZERO = 1e-10
#: Stiffness over mass below this fraction of the largest is rounding error of a rigid-body mode.
_NOISE = 1e-18
#: Modal damping below this fraction of the largest is rounding error.
_NONE = 1e-13

_ComplexArray = NDArray[Any]


class _Damped(NamedTuple):
    """Complex modes, in the order of the corresponding undamped modes.

    ``eigenvalues`` (k,) 1/s: of a conjugate pair the one with positive imaginary part, of two real
    ones the slower; ``ratio`` (k,); ``vectors`` (k, k): columns, in undamped modes.
    """

    eigenvalues: _ComplexArray
    ratio: FloatArray
    vectors: _ComplexArray


def _undamped(M: FloatArray, K: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve K x = lambda M x for all eigenpairs, accurately for the lowest.

    The stiffest modes of a fine mesh are 1e10 times stiffer than the lowest, which would lose their
    digits in a direct solution. In ``M x = mu (K + s M) x`` the lowest modes have the largest mu.
    """
    if M.size == 0:
        return np.zeros(0), np.zeros((0, 0))
    shift = _positive_shift(M, K)
    mu, vectors = linalg.eigh(M, K + shift * M)
    squared = 1.0 / mu[::-1] - shift
    vectors = vectors[:, ::-1] / np.sqrt(mu[::-1])
    squared[np.abs(squared) < _ZERO * shift] = 0.0
    largest = np.argmax(np.abs(vectors), axis=0)
    signs = np.sign(vectors[largest, np.arange(vectors.shape[1])])
    return squared, vectors * signs


def _positive_shift(M: FloatArray, K: FloatArray) -> float:
    """Return a shift s with K + s M positive definite, of the size of the lowest stiffness."""
    diagonal = np.abs(np.diag(K)) / np.diag(M)
    positive = diagonal[diagonal > _NOISE * diagonal.max()]
    shift = float(positive.min()) if positive.size else 1.0
    while True:
        try:
            linalg.cholesky(K + shift * M)
        except np.linalg.LinAlgError:
            shift *= 4.0
        else:
            return shift


def _damped(squared: FloatArray, coupling: FloatArray, damping: FloatArray) -> _Damped:
    """Solve the quadratic eigenvalue problem in k undamped modes; theory (S.3), (S.4)."""
    count = squared.size
    damping = np.where(np.abs(damping) > _NONE * np.max(np.abs(damping), initial=0.0), damping, 0.0)
    if not np.any(coupling) and not np.any(damping - np.diag(np.diag(damping))):
        half = np.diag(damping) / 2.0
        root = np.sqrt((half * half - squared).astype(complex))
        pairs = np.stack([root - half, -root - half])
        return _Damped(pairs[0] + 0.0, _ratio(*pairs), np.eye(count, dtype=complex))
    # With the states frequency times displacement, and rate, no entry is a squared frequency.
    scale = np.sqrt(np.abs(squared))
    scale[scale == 0.0] = np.min(scale[scale > 0.0], initial=1.0)
    zero = np.zeros((count, count))
    stiffness = (np.diag(squared) + coupling) / scale
    values, vectors = linalg.eig(np.block([[zero, np.diag(scale)], [-stiffness, -damping]]))
    shapes = vectors[:count] / scale[:, None]
    first, second = _matched(values, shapes)
    turned = shapes[:, first] / np.linalg.norm(shapes[:, first], axis=0)
    largest = turned[np.argmax(np.abs(turned), axis=0), np.arange(count)]
    turned = turned * np.abs(largest) / largest
    return _Damped(values[first], _ratio(values[first], values[second]), turned)


def _ratio(first: _ComplexArray, second: _ComplexArray) -> FloatArray:
    """Return the damping ratio of each pair of eigenvalues; NaN without a positive product."""
    product = (first * second).real
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = -(first + second).real / (2.0 * np.sqrt(product))
    return np.asarray(np.where(product > 0.0, ratio, np.nan))


def _matched(values: _ComplexArray, shapes: _ComplexArray) -> tuple[NDArray[np.intp], Any]:
    """Return the two eigenvalues of each undamped mode, matched by shape.

    The match uses the magnitude of each undamped mode in the shapes (k, 2k). Modes whose pairs
    have become real eigenvalues by damping are matched to two real ones each.
    """
    count = len(shapes)
    share = np.abs(shapes) ** 2 / np.maximum(np.sum(np.abs(shapes) ** 2, axis=0), 1e-300)
    above = np.flatnonzero(values.imag > 0.0)
    first, second = np.full(count, -1), np.full(count, -1)
    rows, columns = optimize.linear_sum_assignment(share[:, above], maximize=True)
    first[rows] = above[columns]
    below = np.flatnonzero(values.imag < 0.0)  # in LAPACK's order each follows its conjugate
    second[rows] = below[columns]
    left = np.flatnonzero(first < 0)
    real = np.flatnonzero(values.imag == 0.0)
    rows, columns = optimize.linear_sum_assignment(
        np.repeat(share[left][:, real], 2, axis=0), maximize=True
    )
    pairs = real[columns[np.argsort(rows)]].reshape(-1, 2)
    slower = np.argsort(-values[pairs].real, axis=1)
    pairs = np.take_along_axis(pairs, slower, axis=1)
    first[left], second[left] = pairs.T
    return first, second


def lowest_frequency(arm: Arm) -> float:
    """Return the lowest angular frequency (rad/s) of the straight arm with locked joints.

    Gravity and nonlinear springs do not act, and gears are at one end of their backlash. The
    frequency is infinite for a rigid arm. Coordinates of the base that no spring holds are locked,
    too. Closures do not count: they only raise frequencies.
    """
    constants = arm.assembly.constants
    springless = [c.place for c in arm.assembly.base if constants.joint_stiffness[c.body] == 0.0]
    elastic = np.setdiff1d(np.arange(arm.dof), [*arm.joint_index, *springless])
    if not elastic.size:
        return np.inf
    stiffness = constants.joint_stiffness
    contacts = constants.limits[:, 2]  # of the backlash
    stiffness = np.where(stiffness == 0.0, contacts, stiffness)
    springs = np.concatenate([stiffness[:, None], constants.w2], axis=1)
    mass = arm.mass_matrix(arm.rest(np.zeros(arm.n_joints)))[np.ix_(elastic, elastic)]
    square = linalg.eigh(np.diag(arm.unpadded(springs)[elastic]), mass, eigvals_only=True)
    return float(np.sqrt(square[0]))
