"""Coordinates of linear controllers of mechanisms: theory page "mechanisms", (M.25), (M.26).

With the motions ``q = Z y`` that keep the loops closed, the closure forces do not appear in
``Z' M Z y'' + Z' D Z y' + Z' K Z y = Z' f``. Joint torques do not change the momentum of a base
that moves freely. Its displacements with the momentum zero are those with ``M_b Z y = 0`` in the
rows b of the base: the base follows the other coordinates, and motions of the whole arm are left
out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm, turning_joints
from flexarm.arm.closed import Motions, closed_posture, held_joints, independent_motions, motions_of
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import InputName, LinearModel, OutputName, state_names
from flexarm.linear.statics.equilibrium import (
    Equilibrium,
    equilibrium,
    loose_coordinates,
    total_mass,
)
from flexarm.model import Contact

#: Torque of a joint without a motor, over the weight of the arm times its reach, that is due to
#: rounding of a posture in which it is not needed.
_NEEDED = 1e-4


class MinimalCoordinates:
    """Independent coordinates of an arm, with those of its actuated joints if possible.

    Args:
        arm: the arm. actuated: numbers of the joints with a motor; None for all.
        posture: (joints,) near which the loops close.

    Attributes:
        chosen: (k,) indices in q of the coordinates y; all of them for a tree on a fixed base.
        driven: (joints,) whether each joint has a motor.
        led: (a,) positions in ``chosen`` of actuated joints.
        unbalanced: (k - a,) positions of the others, on which no motor acts directly.
        elastic: positions of coordinates that are neither joints nor the base.
        drifting: indices in q of base coordinates that keep their momentum.
    """

    def __init__(
        self,
        arm: Arm,
        actuated: Sequence[int] | None,
        posture: FloatArray,
        contacts: Sequence[Contact] = (),
    ) -> None:
        self.arm = arm
        everything, places = np.arange(arm.dof), arm.joint_index
        if actuated is not None:
            places = np.unique(held_joints(arm, actuated, "actuated"))
        self.driven = np.isin(arm.joint_index, places)
        self.drifting = drifting(arm, contacts)
        self._fixed = places
        free = np.setdiff1d(everything, self.drifting)
        q = arm.rest(self.closed(posture))
        motions = independent_motions(arm, q, free, places if arm.closure_rows else None)
        self.chosen, self._dependent = motions.independent, motions.dependent
        self._kept = np.union1d(self.chosen, self.drifting)
        joints = np.isin(self.chosen, arm.joint_index)
        self.led = np.flatnonzero(np.isin(self.chosen, places))
        self.unbalanced = np.flatnonzero(~np.isin(self.chosen, places))
        base = [coordinate.place for coordinate in arm.assembly.base]
        self.elastic = np.flatnonzero(~joints & ~np.isin(self.chosen, base))
        self._held = None
        if actuated is not None:
            self._held = arm.joint_numbers[np.isin(arm.joint_index, self.chosen)].tolist()

    def closed(self, posture: FloatArray) -> FloatArray:
        """Return joint angles (joints,) near a posture with closed loops, by passive joints."""
        arm = self.arm
        if not arm.closure_rows:
            return posture
        rigid = arm.rigid()
        fixed = rigid.joint_index[np.isin(arm.joint_index, self._fixed)]
        fixed = fixed if fixed.size < arm.n_joints else fixed[:0]
        return closed_posture(rigid, rigid.rest(posture), fixed)[0][rigid.joint_index]

    def closed_near(self, posture: FloatArray, others: FloatArray) -> FloatArray:
        """Return closed postures (T, joints) in the working mode of a posture (joints,).

        Each one begins at the passive joints of the nearest one before.
        """
        postures = [self.closed(posture)]
        for other in others:
            apart = np.sum((np.array(postures) - other)[:, self.driven] ** 2, axis=1)
            near = postures[int(np.argmin(apart))]
            postures.append(self.closed(np.where(self.driven, other, near)))
        return np.array(postures[1:])

    def at_rest(self, posture: FloatArray, contacts: Sequence[Contact] = ()) -> Equilibrium:
        """Return the equilibrium in a posture (joints,) that the motors hold.

        Raises:
            InputError: if a joint without a motor must be held.
        """
        if self._held is None:
            return equilibrium(self.arm, posture, contacts=contacts)
        arm = self.arm
        rest = equilibrium(arm, posture, contacts=contacts, held=self._held)
        weight = total_mass(arm) * math.hypot(*arm.spec.gravity)
        sizes = np.where(turning_joints(arm), arm.reach, 1.0)
        wrong = np.abs(rest.torque) > _NEEDED * weight * sizes
        wrong &= ~self.driven
        if np.any(wrong):
            listed = arm.joint_numbers[wrong].tolist()
            rule = "be one that the motors hold"
            value = f"a posture that needs a torque at joints {listed}, which have no motor"
            raise InputError(Problem("posture", rule, value))
        return rest

    def motions(self, q: FloatArray) -> Motions:
        """Return the motions that keep the loops closed at q (dof,), drift included."""
        if not self._dependent.size:
            return independent_motions(self.arm, q, self._kept)
        J = self.arm.closure_jacobian(q)
        return motions_of(self.arm, J, self._kept, self._dependent)

    def basis(self, q: FloatArray, motions: Motions | None = None) -> FloatArray:
        """Return the displacements Z (dof, k) per coordinate at q (dof,); (M.25), (M.26)."""
        motions = self.motions(q) if motions is None else motions
        whole = motions.displacements(np.eye(self._kept.size))
        if not self.drifting.size:
            return np.asarray(whole)
        mass = whole.T @ self.arm.mass_matrix(q) @ whole
        drift = np.isin(self._kept, self.drifting)
        follow = -np.linalg.solve(mass[np.ix_(drift, drift)], mass[np.ix_(drift, ~drift)])
        return np.asarray(whole[:, ~drift] + whole[:, drift] @ follow)

    def linearized(
        self,
        rest: Equilibrium,
        inputs: Sequence[InputName],
        outputs: Sequence[OutputName],
        sliding: bool = False,
    ) -> LinearModel:
        """Return the linear model at an equilibrium in these coordinates and their rates.

        ``sliding`` joints have no dry friction.
        """
        arm = without_dry_friction(self.arm) if sliding else self.arm
        model = linearize(arm, rest, inputs=inputs, outputs=outputs)
        if self.chosen.size == self.arm.dof:
            return model
        names, units = state_names(self.arm)
        places = [names.index(name) for name in model.states[: len(model.mass)]]
        Z = self.basis(rest.q)[places]
        mass = Z.T @ model.mass @ Z
        L = np.linalg.solve(mass, Z.T @ model.mass)
        both = np.zeros((2 * len(L), 2 * len(Z)))
        both[: len(L), : len(Z)] = both[len(L) :, len(Z) :] = L
        spread = np.zeros(both.T.shape)
        spread[: len(Z), : len(L)] = spread[len(Z) :, len(L) :] = Z
        states = np.append(self.chosen, self.arm.dof + self.chosen)
        return replace(
            model,
            A=both @ model.A @ spread,
            B=both @ model.B,
            C=model.C @ spread,
            states=tuple(names[k] for k in states),
            units={**model.units, **{names[k]: units[k] for k in states}},
            mass=mass,
            damping=Z.T @ model.damping @ Z,
            stiffness=Z.T @ model.stiffness @ Z,
            drift=both @ model.drift,
        )

    def shared(self, force: FloatArray, Z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the torques (joints,) of a motion and the forces that no motor applies.

        ``force`` (dof,) are those of the motion without closures, ``Z`` is the ``basis``. Forces
        that no motor applies are on the coordinates ``unbalanced``. If there are more motors than
        coordinates, the torques have the least norm.
        """
        on = Z.T @ force
        moved = Z[self.arm.joint_index[self.driven]]
        torque = np.zeros(self.arm.n_joints)
        torque[self.driven] = np.linalg.pinv(moved[:, self.led].T) @ on[self.led]
        return torque, on[self.unbalanced] - moved[:, self.unbalanced].T @ torque[self.driven]


def drifting(arm: Arm, contacts: Sequence[Contact] = ()) -> FloatArray:
    """Return the indices in q of base coordinates on which neither force nor closure acts."""
    loose = np.array(loose_coordinates(arm, Environment((), None, contacts)), dtype=np.intp)
    # Closures between links do not act on the base, but their rows depend on its angle while the
    # loops are open.
    if loose.size and any(closure.to_link is None for closure in arm.spec.closures):
        J = arm.closure_jacobian(arm.rest(np.zeros(arm.n_joints)))
        loose = loose[~np.any(J[:, loose], axis=0)]
    body = {coordinate.place: coordinate.body for coordinate in arm.assembly.base}
    damped = [arm.assembly.constants.joint_damping[body[place]] > 0.0 for place in loose]
    return np.asarray(loose[~np.array(damped, dtype=bool)])


def refuse_damped_drift(arm: Arm) -> None:
    """Raise if a coordinate of the base has a damper but no spring.

    Its rate decays, but the place at which it stops is out of reach of joint torques.
    """
    stiffness, damping = arm.spec.base.stiffness, arm.spec.base.damping
    for k, name in enumerate(("x", "y", "angle")):
        if name in arm.spec.base.free and damping[k] > 0.0 and stiffness[k] == 0.0:
            rule = "be zero without a spring for a linear design"
            raise InputError(Problem(f"arm.base.damping[{k}]", rule, shown(damping[k])))


def sliding_rate(arm: Arm) -> float:
    """Return a rate (rad/s) above which dry friction is constant to 1e-7, or zero without it."""
    every = [joint.friction for joint in arm.spec.joints if joint.friction is not None]
    rates = [
        (10.0 * one.model_rate, 4.0 * one.stribeck_rate)
        for one in every
        if any((one.coulomb, one.static, one.coulomb_negative))
    ]
    return max((max(pair) for pair in rates), default=0.0)


@once_per_arm
def without_dry_friction(arm: Arm) -> Arm:
    """Return an arm with viscous friction only; the same object if there is no dry friction."""
    if not sliding_rate(arm):
        return arm
    dry = {"coulomb": 0.0, "static": None, "coulomb_negative": None}
    dry |= {"bristle_stiffness": None, "bristle_damping": 0.0}
    frictions = [joint.friction and joint.friction.replace(**dry) for joint in arm.spec.joints]
    pairs = zip(arm.spec.joints, frictions, strict=True)
    return Arm(arm.spec.replace(joints=[joint.replace(friction=own) for joint, own in pairs]))
