"""Linear-quadratic regulator with a Kalman filter, about a motion: (C.20) to (C.28)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_kind, check_nonnegative
from flexarm.arm import Arm
from flexarm.bending import one_warning, warn_of_first
from flexarm.control.base import Controller, FloatArray, Measurement, Needs, Reference
from flexarm.control.gains import check_sample_time
from flexarm.control_design.default_requirements import wishes_of
from flexarm.control_design.flexible_model import FlexibleModel
from flexarm.control_design.linear_design import (
    Design,
    design,
    preview_gain,
    scales,
)
from flexarm.control_design.nominal import Nominal, PreviewedReference, RecordedRun, strain_matrix
from flexarm.control_design.posture_grid import Interpolated, PostureGrid
from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.loop_analysis.margin_design import for_margin
from flexarm.loop_analysis.margins import loop_at

#: Number of intervals of the preview, and its largest length, s.
_NODES, _LONGEST = 64, 60.0

#: Largest recovery and uncertainty. Beyond it rounding errors dominate a design.
_MOST_UNSURE = 1e6


class LQG(Controller):
    """Linear-quadratic feedback of the state of a flexible arm, estimated by a Kalman filter.

    The design uses `linearize` at rest in a posture, sampled exactly. The elastic forces along the
    reference are known in advance, and the preview compensates them optimally.

    Args:
        arm: model of the arm.
        posture: (joints,) rad, posture of the design; zeros by default.
        schedule: for each joint None, or increasing angles (rad). Gains are designed on the grid of
            these angles, with the other angles of ``posture``, and interpolated.
        acceptable: mapping from outputs of `linearize` to their acceptable deviations, in their
            units, which determine the weights (Bryson's rule). By default 10 mrad of
            ``joint_angle``, 10 mm of ``tip`` and 0.2 rad/s of ``joint_rate``.
        acceptable_torque: N m, one number or one for each joint; by default the torque that
            accelerates each joint of the rigid model by 10 rad/s^2.
        measured: mapping from readings, out of ``joint_angle``, ``joint_rate``, ``strain`` and
            ``tip``, to the standard deviations of their noise. By default 0.1 mrad of joint
            angles, and 2e-5 of strain if the arm has gauges.
        disturbance: mapping from inputs of `linearize` that act as unmeasured disturbances to their
            standard deviations. By default a tenth of the acceptable torque for ``torque``, and
            for ``tip_force`` a fifth of the largest acceptable torque over the length of the arm.
        integral: True, or the output whose deviation is integrated: "joint_angle" or "tip" (which
            must then be measured), or a mapping from it to its acceptable integral (rad s, m s).
        recovery: loop-transfer recovery: fictitious torque noise of the filter, relative to
            ``acceptable_torque``. A larger value brings the margins closer to those of a regulator
            that measures the whole state, and amplifies noise (Doyle and Stein 1981).
        rigidity_uncertainty: relative error of the stiffness of the links for which the design is
            robust, such as 0.3. The filter then includes elastic forces of this relative size as
            noise, and the regulator damps vibrations more (Tahk and Speyer 1987).
        torque_limit: N m, one number or one for each joint, or None.
        preview: s, span of the reference that is known in advance.
        nominal: result of ``simulate`` that replaces the reference as nominal motion.
        sample_time: s. Setting it later repeats the design.

    Attributes:
        designs: the `Design` of each posture of the grid.

    Raises:
        InputError: if a shape, name or number is wrong, ``acceptable`` gives no weight to an
            undamped mode, or a mode is not detectable from ``measured``.
        EquilibriumError: if the arm has no equilibrium at a posture.
    """

    name = "lqg"
    memory = ("_known", "_whole")
    references: ClassVar[str] = "BrysonHo1975 DoyleStein1981 Maciejowski1985 TahkSpeyer1987"

    def __init__(
        self,
        arm: Arm,
        posture: ArrayLike | None = None,
        *,
        schedule: Sequence[ArrayLike | None] | None = None,
        acceptable: Mapping[str, ArrayLike] | None = None,
        acceptable_torque: ArrayLike | None = None,
        measured: Mapping[str, ArrayLike] | None = None,
        disturbance: Mapping[str, ArrayLike] | None = None,
        integral: bool | str | Mapping[str, ArrayLike] | None = None,
        recovery: float = 0.0,
        rigidity_uncertainty: float = 0.0,
        torque_limit: ArrayLike | None = None,
        preview: float = 0.5,
        nominal: Any = None,
        sample_time: float = 1e-3,
    ) -> None:
        where = type(self).__name__
        self.arm = check_kind(where, "arm", arm, Arm)
        given = np.zeros(arm.joints) if posture is None else posture
        self.posture = check_array(where, "posture", given, (arm.joints,))
        self.schedule = schedule
        self.wishes = wishes_of(
            where, arm, self.posture, acceptable, acceptable_torque, measured, disturbance, integral
        )
        self.wishes = replace(
            self.wishes,
            recovery=check_nonnegative(where, "recovery", recovery, _MOST_UNSURE),
            rigidity_uncertainty=check_nonnegative(
                where, "rigidity_uncertainty", rigidity_uncertainty, _MOST_UNSURE
            ),
        )
        self.torque_limit = (
            None
            if torque_limit is None
            else scales(where, "torque_limit", torque_limit, arm.joints)
        )
        self.preview = float(check_array(where, "preview", preview, ()))
        if not 0.0 <= self.preview <= _LONGEST:
            rule = f"be from 0 to {_LONGEST:g} s"
            raise InputError(Problem(where, "preview", rule, shown(preview)))
        self.nominal = nominal
        self._model = FlexibleModel(arm)
        self._strains = strain_matrix(arm)
        self._grid = PostureGrid(where, self.posture, schedule)
        with one_warning() as bent:
            self.sample_time = sample_time
        warn_of_first(bent)

    @property
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    def sample_time(self, value: float) -> None:
        where = type(self).__name__
        self._sample_time = check_sample_time(where, value)
        with one_warning() as bent:
            self.designs = self._design_all(where)
        self._prepare(where)
        warn_of_first(bent)

    def _design_all(self, where: str) -> tuple[Design, ...]:
        return tuple(
            design(where, self.arm, posture, self.wishes, self._sample_time)
            for posture in self._grid.postures
        )

    def _known_force_gain(self, item: Design) -> FloatArray:
        """Return the torque per previewed elastic force, (joints, nodes, dof - joints)."""
        return preview_gain(item, self._previewed, self._stride)

    def _prepare(self, where: str) -> None:
        """Compute the arrays that ``update`` uses from the designs."""
        first = self.designs[0]
        self._states, self._outputs = len(first.A), len(first.C)
        self._integrals = len(first.integrated)
        samples = round(self.preview / self._sample_time)
        self._stride = max(1, -(-samples // _NODES))
        self._previewed = self._stride * (-(-samples // self._stride))
        self._arrays = Interpolated(self._grid, [self._node(item) for item in self.designs])
        self._link()
        self._motion = self._nominal_motion(where)
        n, p, m = self._states, self._outputs, self.arm.joints
        self._joints = m
        self._known = np.zeros(n + p)  # prediction, measurement
        still = np.zeros((1, self.arm.dof))
        self._places, start = [], n
        parts = self._shown_parts(still[:, :m], still, still)
        for name, part in zip(self.wishes.measured, parts, strict=True):
            self._places.append((name, slice(start, start + part.shape[1])))
            start += part.shape[1]
        self._whole = np.zeros(n + self._integrals)  # estimate, integrals
        # The parts are the estimate, the torque and the elastic forces.
        self._pushed = np.zeros(n + m + self._model.elastic.size)
        self.reset()

    def _link(self) -> None:
        """Set attributes for the arrays that depend on posture."""
        self._correct, self._gain, self._predict, self._ahead = self._arrays.arrays[:4]

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._link()  # the interpolated arrays of a copy are new objects

    def _node(self, item: Design) -> list[FloatArray]:
        """Return the arrays that are interpolated over posture; (C.22) to (C.27)."""
        kept = np.eye(len(item.A)) - item.estimator @ item.C
        ahead = self._known_force_gain(item)
        return [
            np.hstack([kept, item.estimator]),
            item.gain,
            np.hstack([item.A, item.B, item.B_elastic]),
            ahead.reshape(len(ahead), -1),
        ]

    @property
    def _steps(self) -> int:
        """Number of samples of the nominal motion to compute, including the current one."""
        return self._previewed + 1

    def _nominal_motion(self, where: str) -> PreviewedReference | RecordedRun:
        if self.nominal is not None:
            return RecordedRun(
                where, self._model, self.nominal, self.sample_time, self._steps, self._show
            )
        sag = Interpolated(self._grid, [[item.sag] for item in self.designs])
        return PreviewedReference(self._model, sag, self.sample_time, self._steps, self._show)

    def reset(self) -> None:
        """Clear the estimate, the integrals and the nominal motion."""
        self._known[:] = 0.0
        self._whole[:] = 0.0
        self._motion.reset()

    def needs(self, arm: Arm, reference: Reference | None) -> Needs:
        """See ``Controller.needs``."""
        first = () if self.nominal is not None else ("joint_angle",)
        read = tuple(dict.fromkeys([*first, *self.wishes.measured, *self.wishes.integrated]))
        return Needs(self.arm.joints, read, len(self.arm.gauges) if "strain" in read else None)

    @property
    def estimate(self) -> FloatArray:
        """Estimated deviation of (q, qd) from the nominal motion at the last sample (2 dof,)."""
        return self._whole[: self._states].copy()

    def update(self, t: float, measurement: Measurement, reference: Reference | None) -> FloatArray:
        """See ``Controller.update``."""
        n, m = self._states, self._joints
        found = self.posture if self.nominal is not None else np.asarray(measurement.joint_angle)
        nominal = self._motion.at(t, found, reference)
        self._arrays.move(nominal.angle)
        for name, places in self._places:
            self._known[places] = measurement[name]
        self._known[n:] -= nominal.shown
        # ``dot`` takes half the time of ``@`` on small arrays.
        self._whole[:n] = self._pushed[:n] = self._correct.dot(self._known)
        wanted = nominal.torque + self._feedback()
        torque = self._within_limits(wanted)
        self._pushed[n : n + m] = torque - nominal.torque
        self._pushed[n + m :] = nominal.missing
        self._known[:n] = self._predict.dot(self._pushed)
        if self._integrals:
            self._integrate(measurement, nominal, wanted - torque)
        return torque

    def _show(self, angle: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Return the measurement (T, p) at T instants of the nominal motion."""
        return np.concatenate(self._shown_parts(angle, q, qd), axis=1)

    def _shown_parts(self, angle: FloatArray, q: FloatArray, qd: FloatArray) -> list[FloatArray]:
        parts = []
        for name in self.wishes.measured:
            if name == "joint_angle":
                parts.append(angle)
            elif name == "joint_rate":
                parts.append(qd[:, self.arm.joint_index])
            elif name == "strain":
                parts.append(q @ self._strains.T)
            else:
                bent = q[:, self._model.elastic]
                tips = [self._model.tip(a, b) for a, b in zip(angle, bent, strict=True)]
                parts.append(np.array(tips))
        return parts

    def _feedback(self) -> FloatArray:
        """Return the torque (joints,) N m added to the nominal one; (C.24), (C.27)."""
        known = self._motion.missing[:: self._stride].ravel()
        fed: FloatArray = -self._gain.dot(self._whole) - self._ahead.dot(known)
        return fed

    def _within_limits(self, torque: FloatArray) -> FloatArray:
        if self.torque_limit is None:
            return torque
        # ``minimum`` and ``maximum`` take half the time of ``clip``.
        cut: FloatArray = np.minimum(np.maximum(torque, -self.torque_limit), self.torque_limit)
        return cut

    def _integrate(self, measurement: Measurement, nominal: Nominal, excess: FloatArray) -> None:
        """Advance the integrals, unless that would increase a torque at its limit."""
        (name,) = self.wishes.integrated
        wanted = nominal.angle if name == "joint_angle" else self._wanted_tip(nominal)
        step = self.sample_time * (getattr(measurement, name) - wanted)
        if np.any(excess):
            asked = -(self._gain[:, self._states :] @ step)
            if asked @ excess > 0.0:
                return
        self._whole[self._states :] += step

    def _wanted_tip(self, nominal: Nominal) -> FloatArray:
        """Return the nominal tip (2,), m: of a reference, that of straight links."""
        bend = nominal.q[self._model.elastic]
        return self._model.tip(nominal.angle, bend if self.nominal is not None else 0.0 * bend)

    def loop_poles(self, plant: Arm | None = None, posture: ArrayLike | None = None) -> FloatArray:
        """Return the poles (k,) of the sampled loop around an arm at rest, 1/s, slowest first.

        Args:
            plant: arm with the same number of joints; None for the model. The state of the loop is
                the state of the plant, the estimate and the integrals.
            posture: (joints,) rad; None for the posture of the design.

        Poles with negative real parts are stable. Poles are ``log(z) / sample_time``, so vibrations
        above half the sampling rate are aliased below it.

        Raises:
            InputError: if ``plant`` has another number of joints, or ``posture`` the wrong shape.
            EquilibriumError: if the plant has no equilibrium at ``posture``.
        """
        where = f"{type(self).__name__}.loop_poles"
        arm = self.arm if plant is None else check_kind(where, "plant", plant, Arm)
        if arm.joints != self.arm.joints:
            rule = f"have the number of joints of the arm, {self.arm.joints}"
            raise InputError(Problem(where, "plant", rule, str(arm.joints)))
        at = check_array(
            where, "posture", self.posture if posture is None else posture, (self.arm.joints,)
        )
        with one_warning() as bent:
            poles: FloatArray = loop_at(self, plant, at).poles()
        warn_of_first(bent)
        return poles

    @classmethod
    def for_margin(
        cls,
        arm: Arm,
        posture: ArrayLike | None = None,
        *,
        plants: Arm | Sequence[Arm] | Mapping[str, Arm],
        disk_margin: float = 0.3,
        postures: ArrayLike | None = None,
        **options: Any,
    ) -> Self:
        """Design a controller with a given disk margin for several arms.

        ``rigidity_uncertainty`` and ``recovery`` are increased from zero until `loop_margins`
        returns at least this margin at every joint of every plant in every posture.

        Args:
            arm, posture, options: as for the class.
            plants: arms that the margin must hold for, in addition to ``arm``.
            disk_margin: smallest accepted disk margin, above 0 and below 2.
            postures: (k, joints) rad, where the margins are evaluated; None for those of the
                design.

        Raises:
            InputError: as for the class, or if no design has the margin; the message has the best
                one found.
        """
        with one_warning() as bent:
            made = for_margin(cls, arm, posture, plants, disk_margin, postures, options)
        warn_of_first(bent)
        return made

    def at_rest(self) -> LQG:
        """Return the controller, or a copy without ``nominal`` that keeps the arm at rest."""
        if self.nominal is None:
            return self
        mine = deepcopy(self)
        mine.nominal = None
        mine._motion = mine._nominal_motion(type(self).__name__)
        return mine
