"""Static equilibrium of an arm under gravity, loads and joint torques, and motion close to it.

Matrices of small deviations: theory page "small motion", (S.2).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import EMPTY, Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import check_state, coordinate_sizes, modal_size
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.closed import (
    Motions,
    held_joints,
    independent_motions,
    refuse_open,
    stiffness_of,
)
from flexarm.base.errors import (
    FlexarmError,
    InputError,
    LargeDeflectionWarning,
    Problem,
    check_array,
    few,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import linalg
from flexarm.base.notebook import html_table
from flexarm.kernels.derivatives.tangent import inverse_jacobian
from flexarm.linear.statics.axial import closure_warning, geometric_stiffness, warn_of_theory
from flexarm.model import Contact, Load
from flexarm.model.arm.spec import serial_only


class Tangent(NamedTuple):
    """Matrices M, D, K of M qdd + D qd + K q for small deviations, each (dof, dof)."""

    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray


def tangent(
    arm: Arm,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
    environment: Environment = EMPTY,
    closure_forces: FloatArray | None = None,
) -> Tangent:
    """Linearise the inverse dynamics about a motion q, qd, qdd, each (dof,); exact to rounding.

    If qd is not zero, ``damping`` includes gyroscopic terms and ``stiffness`` centrifugal terms.
    With ``closure_forces`` (rows,), ``stiffness`` includes the curvature of the closures.
    """
    kernels = KernelView(arm.assembly.constants, complex)
    if closure_forces is not None:
        kernels.set_closure_forces(closure_forces)
    n, width = kernels.shape
    jacobian = np.zeros((n, width, 2, n, width))
    motion = arm.padded(np.stack([q, qd])).astype(complex), arm.padded(qdd), environment.placed(arm)
    kernels.call(inverse_jacobian, *motion, kernels.work, jacobian)
    kept = arm.assembly.coordinates
    by_state = jacobian.reshape(n * width, 2, n * width)[kept]
    return Tangent(arm.mass_matrix(q), by_state[:, 1, kept], by_state[:, 0, kept])


_STEPS = 40


def steady_rates(arm: Arm, spin: float) -> FloatArray:
    """Return the rates (dof,) of an arm that rotates as a whole with ``spin``, rad/s."""
    rates = np.zeros(arm.dof)
    if spin == 0.0:
        return rates
    serial_only(arm.spec, "a spin")
    if any(arm.spec.gravity):
        raise InputError(Problem("spin", "be zero for an arm with gravity", shown(spin)))
    if arm.n_joints == 0 or arm.joint_numbers[0] != 1:
        rule = "be zero for an arm whose first joint is fixed"
        raise InputError(Problem("spin", rule, shown(spin)))
    rates[arm.joint_index[0]] = spin
    return rates


def steady_shape(arm: Arm, q: FloatArray, spin: float) -> FloatArray:
    """Compute the steady shape q (dof,) at a constant spin, with joint angles of ``q``; (S.5)."""
    rates, still = steady_rates(arm, spin), np.zeros(arm.dof)
    bending = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    if spin == 0.0 or bending.size == 0:
        return q
    found, part, unit = q.copy(), np.ix_(bending, bending), coordinate_sizes(arm)[bending]
    for _ in range(_STEPS):
        missing = arm.inverse_dynamics(found, rates, still)[bending]
        try:
            stiffness = tangent(arm, found, rates, still).stiffness[part]
            step = -np.linalg.solve(np.asarray_chkfinite(stiffness), missing)
        except np.linalg.LinAlgError:
            break
        found[bending] += step
        # Newton's method converges quadratically: after a step this small only rounding remains.
        if np.max(np.abs(step / unit)) <= 1e-9 * (1e-3 + np.max(np.abs(found[bending] / unit))):
            return found
    raise EquilibriumError(0.0, q, f"the links have no steady shape at {spin:g} rad/s.")


#: Residual forces below this fraction of the largest force count as zero.
_RESIDUAL = 1e-11
#: Force on a base that moves freely, over the loads, that rounding errors explain.
_UNBALANCED = 1e-9
_NEWTON_STEPS = 30
_DESCENT_STEPS, _HALVINGS = 300, 20
_SMALLEST_STEP = 1e-4
#: Largest step of Newton's method, as a rotation (rad): where no spring acts it has no limit.
_FARTHEST = 3.0


class EquilibriumError(FlexarmError, RuntimeError):
    """No equilibrium was found.

    Attributes:
        load_fraction: largest fraction of gravity and loads for which one was found.
        q: (dof,) equilibrium under that fraction.
    """

    def __init__(self, load_fraction: float, q: FloatArray, reason: str) -> None:
        super().__init__(load_fraction, q, reason)
        self.load_fraction = load_fraction
        self.q = q
        self.reason = reason

    def __str__(self) -> str:
        if self.load_fraction == 0.0:
            return f"no equilibrium found: {self.reason}"
        part = f"{self.load_fraction:.4g} of gravity and loads"
        return f"no equilibrium found above {part}: {self.reason}"


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A static equilibrium of an arm.

    Attributes:
        q: (dof,) coordinates.
        torque: (joints,) N m of the motors: the prescribed torques, or those that lock the joints.
        stable: whether the stiffness of the coordinates that are free is positive definite. It
            includes that by axial forces, as in the second-order theory, for the linear theory too.
        lowest_eigenvalue: of this stiffness over mass, rad^2/s^2: the lowest squared frequency;
            negative if unstable.
        loads: loads in addition to gravity, including the force at the tip.
        contacts: contacts between the arm and surfaces.
        closure_forces: (closure_rows,) of the closures on their first points, N and N m, in the
            order of `Arm.closure_gaps`.
    """

    q: FloatArray
    torque: FloatArray
    stable: bool
    lowest_eigenvalue: float
    loads: tuple[Load, ...] = ()
    contacts: tuple[Contact, ...] = ()
    closure_forces: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def environment(self) -> Environment:
        """Loads and contacts."""
        return Environment(self.loads, None, self.contacts)

    def __repr__(self) -> str:
        stable = "stable" if self.stable else "unstable"
        held = f", held by {few(self.torque)} N m" if self.torque.size else ""
        count = len(self.loads)
        loads = f", {count} load{'s' * (count > 1)}" if count else ""
        return f"<flexarm.Equilibrium: {self.q.size} coordinates, {stable}{held}{loads}>"

    def _repr_html_(self) -> str:
        rows: list[tuple[str, object]] = [
            ("stable", "yes" if self.stable else "no"),
            ("lowest eigenvalue (rad²/s²)", self.lowest_eigenvalue),
            ("coordinates q", few(self.q)),
        ]
        rows += [(f"torque of joint {k} (N m)", t) for k, t in enumerate(self.torque, 1)]
        if self.closure_forces.size:
            rows.append(("forces of closures (N, N m)", few(self.closure_forces)))
        return html_table("flexarm.Equilibrium", ("property", "value"), rows)


@public_call
def equilibrium(
    arm: Arm,
    joint_angles: ArrayLike | None = None,
    *,
    torque: ArrayLike | None = None,
    tip_force: ArrayLike | None = None,
    loads: Sequence[Load] = (),
    base_acceleration: ArrayLike | None = None,
    contacts: Sequence[Contact] = (),
    start: ArrayLike | None = None,
    held: Sequence[int] | None = None,
) -> Equilibrium:
    """Compute a static equilibrium of an arm.

    Args:
        arm: the arm, with its gravity.
        joint_angles: (joints,) relative, rad, at which the joints are locked, all zero by
            default; the links deflect. Or q (dof,) with these angles, where the search starts.
        torque: (joints,) N m that act on free joints. ``joint_angles`` is then the starting point
            of the search.
        tip_force, loads: as in ``Arm.forward_dynamics``, without a factor of time.
        base_acceleration: (ax, ay) m/s^2, constant; the equilibrium is relative to the base.
        contacts: contacts of points of the arm with surfaces, without friction.
        start: q (dof,) from which the search starts under the full load. By default it starts from
            straight links without load.
        held: numbers of the joints that are locked, at ``joint_angles`` or as in ``start``; by
            default all of them without ``torque``, and none with it. The others are free.

    Raises:
        InputError: if an argument has the wrong shape or is not finite, ``held`` is not the numbers
            of joints that can move, the start does not close the loops of a mechanism, or a closure
            depends on the others while the locked joints do not move.
        EquilibriumError: if no equilibrium was found. The exception has the last equilibrium found
            under a part of the load.

    Warns:
        LargeDeflectionWarning: a link bends too far, or has too large an axial load, for the theory
            of the arm.

    Newton's method with the exact stiffness matrix; gravity and loads grow from zero in adaptive
    steps, so that large deflections are reached. Descent steps then search for a stable equilibrium
    if this one is unstable or was not found; with free joints they come first. Friction is
    neglected. Coordinates of a base that no spring holds stay zero, or as in ``start``; if a force
    would accelerate the base, there is no equilibrium. The loops of a mechanism stay closed in all
    steps.
    """
    if base_acceleration is not None:
        felt = arm.spec.gravity - check_array("base_acceleration", base_acceleration, (2,))
        arm = Arm(arm.spec.replace(gravity=felt))
    if torque is not None and joint_angles is None and start is None:
        joint_angles = np.zeros(arm.n_joints)
    angles = np.zeros(arm.n_joints) if joint_angles is None else joint_angles
    q = check_state(arm, "joint_angles", angles)
    if start is not None:
        q = check_array("start", start, (arm.dof,))
    refuse_open(arm, "joint_angles" if start is None else "start", q)
    search = _Search(arm, Environment.of(arm, tip_force, loads, None, contacts))
    if torque is not None:
        search.force[arm.joint_index] = check_array("torque", torque, (arm.n_joints,))
        search.unknown = np.setdiff1d(np.arange(arm.dof), search.loose)
    if held is not None:
        search.hold(held)
    independent_motions(arm, q, search.unknown)  # raises if closures depend on each other
    if start is not None:
        found = search.result(search.follow(q, at_once=True))
    else:
        found = search.best(q, free=bool(np.isin(arm.joint_index, search.unknown).any()))
    warn_of_theory(arm, found.q, found.environment)
    if text := closure_warning(arm, found.closure_forces[None]):
        warn_caller(text, LargeDeflectionWarning)
    return found


def equilibrium_near(arm: Arm, q: FloatArray, tip_force: FloatArray) -> FloatArray:
    """Return q (dof,) at rest with the joints locked as in q, not examined as by `equilibrium`."""
    return _Search(arm, Environment.of(arm, tip_force)).follow(q, at_once=True)


def loose_coordinates(arm: Arm, environment: Environment) -> list[int]:
    """Return the indices in q of coordinates of the base on which no equilibrium depends."""
    if environment.contacts:
        return []
    turning = bool(np.any(arm.spec.gravity)) or bool(environment.loads)
    stiffness = arm.assembly.constants.joint_stiffness
    return [
        coordinate.place
        for coordinate in arm.assembly.base
        if stiffness[coordinate.body] == 0.0 and not (coordinate.name == "angle" and turning)
    ]


def total_mass(arm: Arm) -> float:
    """Return the mass of an arm with its payload and base, kg."""
    c = arm.assembly.constants
    return float(c.mass.sum() + c.tip_mass.sum())


class _Balance(NamedTuple):
    """Forces at a posture: what is missing for rest (k,), and those of closures (rows,)."""

    motions: Motions
    missing: FloatArray
    forces: FloatArray


class _Search:
    """Residual, stiffness and load steps of one equilibrium problem."""

    def __init__(self, arm: Arm, environment: Environment) -> None:
        self.arm, self.loads, self.contacts = arm, environment.loads, environment.contacts
        self.environment = environment
        self.force = np.zeros(arm.dof)
        self.loose = loose_coordinates(arm, environment)
        self.unknown = np.setdiff1d(np.arange(arm.dof), [*arm.joint_index, *self.loose])
        factor = next((load.factor for load in self.loads if load.factor is not None), None)
        if factor is not None:
            rule = "be constant in time"
            value = "a function" if callable(factor) else "a table"
            raise InputError(Problem("Load.factor", rule, value))
        environment.placed(arm)  # raises if a load or a contact is not on the arm

    def hold(self, held: Sequence[int]) -> None:
        """Lock the joints with these numbers, and no others."""
        everything = np.union1d(self.unknown, self.arm.joint_index)
        self.unknown = np.setdiff1d(everything, held_joints(self.arm, held))

    def _scaled(self, fraction: float) -> tuple[Arm, Sequence[Load]]:
        if fraction == 1.0:
            return self.arm, self.loads
        gravity = tuple(fraction * g for g in self.arm.spec.gravity)
        arm = Arm(self.arm.spec.replace(gravity=gravity))
        loads = [load.scaled(fraction) for load in self.loads]
        return arm, loads

    def _force(self, arm: Arm, q: FloatArray, loads: Sequence[Load]) -> FloatArray:
        """Return the generalised force (dof,) required for rest at q."""
        rest = np.zeros(arm.dof)
        return arm.inverse_dynamics(q, rest, rest, loads=loads, contacts=self.contacts)

    def newton(self, q: FloatArray, fraction: float) -> FloatArray:
        """Solve under a fraction of the load, from q; LinAlgError if it does not converge."""
        arm, loads = self._scaled(fraction)
        sizes = coordinate_sizes(arm)
        balance = self._balance(arm, q, loads, fraction)
        if not balance.missing.any():
            return q
        first = np.max(np.abs(balance.missing), initial=0.0)
        for _ in range(_NEWTON_STEPS):
            motions, missing = balance.motions, balance.missing
            unit = sizes[motions.independent]
            K = motions.matrix(stiffness_of(arm, q, balance.forces, loads, self.contacts))
            K *= np.outer(unit, unit)
            step = -np.linalg.solve(np.asarray_chkfinite(K), missing)
            # The stiffest modes carry forces far larger than those of the lowest, so convergence
            # is judged by the size of the displacement step.
            place = q[motions.independent] / unit
            size = np.max(np.abs(step)) / (1e-3 + np.max(np.abs(place)))
            scale = max(first, float(np.max(np.abs(K @ place))))
            longest = shortened = min(1.0, _FARTHEST / max(np.max(np.abs(step)), 1e-300))
            while shortened > 1e-3 * longest:
                trial = motions.closed(arm, q + motions.displacements(shortened * unit * step))
                balance = self._balance(arm, trial, loads, fraction)
                left = np.max(np.abs(balance.missing))
                if left <= max(np.max(np.abs(missing)), _RESIDUAL * scale):
                    break
                shortened *= 0.5
            q, missing = trial, balance.missing
            place = q[motions.independent] / unit
            # Not the largest of all steps: a long one must not excuse the forces after it.
            scale = max(scale, float(np.max(np.abs(K @ place))))
            left = np.max(np.abs(missing))
            if shortened == 1.0 and (size < 1e-12 or left <= _RESIDUAL * scale):
                return q
        raise np.linalg.LinAlgError("Newton's method does not converge")

    def _balance(self, arm: Arm, q: FloatArray, loads: Sequence[Load], fraction: float) -> _Balance:
        force = self._force(arm, q, loads) - fraction * self.force
        motions = independent_motions(arm, q, self.unknown)
        unit = coordinate_sizes(arm)[motions.independent]
        return _Balance(motions, unit * motions.forces(force), motions.multipliers(force))

    def best(self, q: FloatArray, free: bool) -> Equilibrium:
        """Return a stable equilibrium if the search finds one, else an unstable one.

        With load steps Newton's method remains on the branch that begins at the straight arm, and
        descent steps leave this branch where it becomes unstable. With free joints descent comes
        first, because without loads their position is indeterminate.
        """
        if self._without_load(q):
            return self.result(q)
        found, failure = None, None
        for way in (self.descend, self.follow) if free else (self.follow, self.descend):
            try:
                there = way(q)
                lowest = self._lowest(there)
            except EquilibriumError as error:
                failure = failure or error
                continue
            # The arm's own theory guides the search: another branch would not be one of its own.
            if lowest > 0.0:
                return self.result(there)
            found = there if found is None else found
        if found is None:
            assert failure is not None
            raise failure
        return self.result(found)

    def _without_load(self, q: FloatArray) -> bool:
        """Return whether nothing acts on the arm, and its springs at q do not push either."""
        if any(self.arm.spec.gravity) or self.loads or self.contacts or self.force.any():
            return False
        stiffest = max((joint.stiffness for joint in self.arm.spec.joints), default=0.0)
        missing = self._balance(self.arm, q, self.loads, 1.0).missing
        return bool(np.all(np.abs(missing) <= _RESIDUAL * stiffest))

    def descend(self, q: FloatArray) -> FloatArray:
        """Take descent steps under the full load, then converge by Newton's method."""
        arm, begin, near_enough = self.arm, q, 0.1 * _LONGEST
        for _ in range(_DESCENT_STEPS if self.unknown.size else 0):
            try:
                force = self.force - self._force(arm, q, self.loads)
                motions = independent_motions(arm, q, self.unknown)
                if not motions.independent.size:
                    break
                closing = motions.multipliers(-force)
                K = motions.matrix(stiffness_of(arm, q, closing, self.loads, self.contacts))
                M = motions.matrix(arm.mass_matrix(q))
                step, stable = _descent_step(K, M, motions.forces(force), modal_size(arm))
                step = motions.displacements(step)
                turn = _largest_turn(arm, step)
                # A shorter step, if behind it a contact or a stop pushes back by more than this.
                pull, share = force @ step, min(1.0, _LONGEST / max(turn, 1e-300))
                for _ in range(_HALVINGS):
                    trial = motions.closed(arm, q + share * step)
                    if (self.force - self._force(arm, trial, self.loads)) @ step >= -pull:
                        break
                    share *= 0.5
                q = trial
                if stable and turn < near_enough:
                    near_enough = 0.1 * turn  # Newton's method may fail where a stop begins
                    with suppress(np.linalg.LinAlgError):
                        near = self.newton(q, 1.0)
                        if _largest_turn(arm, near - q) < _LONGEST:
                            return near
            except (np.linalg.LinAlgError, ValueError):
                reason = "the arm buckles or swings away."
                raise EquilibriumError(0.0, begin, reason) from None
        raise EquilibriumError(0.0, begin, "the search did not converge.")

    def follow(self, q: FloatArray, at_once: bool = False) -> FloatArray:
        """Increase the load from zero to one; ``at_once`` permits the full load only."""
        done, step = 0.0, 1.0
        while done < 1.0:
            target = min(1.0, done + step)
            try:
                q = self.newton(q, target)
            except (np.linalg.LinAlgError, ValueError):
                step *= 0.25
                if at_once or step < _SMALLEST_STEP:
                    reason = "the arm buckles or swings away."
                    raise EquilibriumError(done, q, reason) from None
            else:
                done, step = target, 2.0 * step
        return q

    def result(self, q: FloatArray) -> Equilibrium:
        """Evaluate stability and collect the torques."""
        arm, force = self.arm, self._force(self.arm, q, self.loads)
        motions = independent_motions(arm, q, self.unknown)
        closing = motions.multipliers(force - self.force)
        if closing.size:
            force = force - arm.closure_jacobian(q).T @ closing
        # Raise if the force would accelerate a base that nothing holds.
        size = math.hypot(*arm.spec.gravity) * total_mass(arm)
        size += sum(math.hypot(*load.force) for load in self.loads)
        for coordinate in arm.assembly.base:
            scale = size * (arm.reach if coordinate.name == "angle" else 1.0)
            held = coordinate.place not in self.loose
            if not held and abs(force[coordinate.place]) > _UNBALANCED * scale:
                reason = f"no spring holds {coordinate.name} of the base against the loads."
                raise EquilibriumError(0.0, q, reason)
        lowest = self._lowest(q, geometric_stiffness(arm, q, self.environment, closing))
        acting = tuple(self.loads), tuple(self.contacts), closing
        return Equilibrium(q, force[arm.joint_index], lowest > 0.0, lowest, *acting)

    def _lowest(self, q: FloatArray, added: FloatArray | None = None) -> float:
        """Return the lowest eigenvalue of stiffness, and what is ``added`` to it, over mass."""
        motions = independent_motions(self.arm, q, self.unknown)
        if motions.independent.size == 0:
            return float(np.inf)
        closing = motions.multipliers(self._force(self.arm, q, self.loads) - self.force)
        K = stiffness_of(self.arm, q, closing, self.loads, self.contacts)
        K = motions.matrix(K if added is None else K + added)
        # Only the symmetric part has a potential; with follower loads flutter remains possible.
        try:
            stored, M = (K + K.T) / 2.0, motions.matrix(self.arm.mass_matrix(q))
            return float(linalg.eigh(stored, M, eigvals_only=True, subset_by_index=[0, 0])[0])
        except np.linalg.LinAlgError:
            reason = (
                "the mass matrix is indefinite there, because links bend beyond the "
                "second-order theory. Give them segments=2 or more."
            )
            raise EquilibriumError(1.0, q, reason) from None


#: Largest rotation (rad) of a joint or of an end of a segment in one step: for larger rotations
#: the linearisation with the present stiffness is not accurate.
_LONGEST = 0.2
#: Lower bound of the eigenvalues relative to the largest: a joint without a spring has a zero one.
_SOFTEST = 1e-12


def _descent_step(
    K: FloatArray, M: FloatArray, force: FloatArray, size: float
) -> tuple[FloatArray, bool]:
    """Return the descent step (k,), at most ``size`` without stiffness, and whether K > 0.

    Newton's method solves K dx = -g whatever the signs of the eigenvalues of the stiffness K, so a
    column that is bent the wrong way returns to the straight, unstable equilibrium. With the
    absolute values of the eigenvalues every step decreases the potential, and near a stable
    equilibrium it is the Newton step (Dauphin et al., Advances in Neural Information Processing
    Systems 27 (2014) 2933-2941, "saddle-free Newton").
    """
    values, vectors = linalg.eigh((K + K.T) / 2.0, M)
    pull = vectors.T @ force
    # Without a stiffness of its own, a free joint moves as on a spring of the size of the force.
    stiffness = np.abs(values)
    soft = stiffness <= _SOFTEST * stiffness.max()
    stiffness[soft] = max(float(np.linalg.norm(pull)) / size, 1e-300)
    return np.asarray(vectors @ (pull / stiffness)), bool(values.min() > 0.0)


def _largest_turn(arm: Arm, step: FloatArray) -> float:
    """Return the largest rotation (rad) of a joint or of an end of a segment in a step (dof,)."""
    rigid = np.ones(arm.dof, dtype=bool)
    for piece in arm.assembly.pieces:
        rigid[piece.modal] = False
    turns = np.abs(step / coordinate_sizes(arm))[rigid].tolist()
    turns += [abs(float(p.shapes.dP @ step[p.modal])) for p in arm.assembly.pieces]
    return max(turns, default=0.0)
