"""Fast inverse dynamics and tip position of a flexible arm, for controllers."""

from __future__ import annotations

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import modal_size
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.hardware.measurement import FloatArray
from flexarm.kernels.observation.observables import poses
from flexarm.kernels.recursion.newton_euler import inverse_dynamics_many

#: Step of central differences by elastic coordinates, relative to ``modal_size``. It rotates links
#: by less than 1e-3 rad, so the error is below a millionth.
_STEP = 1e-5


class FlexibleModel:
    """Inverse dynamics of a flexible arm with moving joints and constant bending.

    The elastic forces are those that no actuator applies, -r in (D.3). Joint angles, rates
    and accelerations are in rad, rad/s, rad/s^2. Arguments are not checked.

    Attributes:
        arm: the arm. elastic: (dof - joints,) indices in q of the elastic coordinates.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        assembly = arm.assembly
        self.elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
        self._kernels = KernelView(assembly.constants)
        self._state = self._kernels.zeros(2)
        self._bodies = assembly.joint_body
        self._joint_places = assembly.coordinates[arm.joint_index]
        self._elastic_places = assembly.coordinates[self.elastic]
        self._poses, self._tip = self._kernels.pose_arrays()

    def forces_many(
        self, angle: FloatArray, rate: FloatArray, acceleration: FloatArray, bend: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return the torques (T, joints) N m and elastic forces (T, dof - joints) of a motion.

        The elastic forces are those that would have to act to keep the bending constant. ``bend``
        (T, dof - joints): the elastic coordinates; their rates and accelerations are zero.
        """
        joints, elastic = self._joint_places, self._elastic_places
        kernels, count = self._kernels, len(angle)
        states, accelerations = kernels.zeros(count, 2), kernels.zeros(count)
        forces = np.empty_like(accelerations)
        flat = states.reshape(count, 2, -1)
        flat[:, 0, joints], flat[:, 1, joints] = angle, rate
        flat[:, 0, elastic] = bend
        accelerations.reshape(count, -1)[:, joints] = acceleration
        kernels.call(
            inverse_dynamics_many, states, accelerations, kernels.loads, kernels.work, forces
        )
        found = forces.reshape(count, -1)
        return found[:, joints], found[:, elastic]

    def chords(self, angle: FloatArray) -> FloatArray:
        """Return the rotations (joints, dof - joints) of the chords of the links by the bending.

        A chord connects a joint with the next one, or with the tip; its rotation, in rad, is
        relative to the joint before, like the joint angle. It does not depend on the posture.
        Between joints without a kink, rigid links with these rotations have the same ends.
        """
        straight = np.diff(self._joints_and_tip(angle, np.zeros(self.elastic.size)), axis=0)
        lengths = np.sum(straight**2, axis=1)
        columns = []
        step = _STEP * modal_size(self.arm)
        for small in step * np.eye(self.elastic.size):
            apart = self._joints_and_tip(angle, small) - self._joints_and_tip(angle, -small)
            x, y = np.diff(apart / (2.0 * step), axis=0).T
            columns.append((straight[:, 0] * y - straight[:, 1] * x) / lengths)
        return np.diff(np.array(columns).T, axis=0, prepend=0.0)

    def _joints_and_tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return the positions (joints + 1, 2) of the joints and of the tip, m."""
        tip = self.tip(angle, bend)
        return np.vstack([self._poses[self._bodies, :2], tip])

    def tip(self, angle: FloatArray, bend: FloatArray) -> FloatArray:
        """Return the position (2,) of the tip, m."""
        # A flat view has one index for each coordinate in the arrays of the kernels.
        q = self._state[0].reshape(-1)
        q[self._joint_places], q[self._elastic_places] = angle, bend
        self._kernels.call(poses, self._state, self._poses, self._tip)
        return self._tip[:2].copy()
