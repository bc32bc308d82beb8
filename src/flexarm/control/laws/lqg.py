"""LQG about a motion: (C.20) to (C.28)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import KW_ONLY
from functools import partial
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import check_kind, check_number, check_positive
from flexarm.base.errors import InputError, Problem, check_array, public_call
from flexarm.control.analysis.margins import loop_at, loop_margins, named_arms
from flexarm.control.contract.base import (
    Arrays,
    Controller,
    ControllerRequirements,
    FloatArray,
    Measurement,
    Reference,
    Rest,
    Step,
    applied,
)
from flexarm.control.contract.parametrised import OfArm
from flexarm.control.design.arm_scales import check_sample_time, design_requirements, typical_rate
from flexarm.control.design.linear_design import (
    CHORD,
    Design,
    design,
    preview_gain,
)
from flexarm.control.design.loop_hardware import OF_DESIGN, LoopHardware, refuse_both
from flexarm.control.design.minimal import MinimalCoordinates, refuse_damped_drift
from flexarm.control.design.nominal import (
    FlexibleModel,
    Interpolated,
    MechanismModel,
    Nominal,
    PostureGrid,
    PreviewedReference,
    RecordedRun,
)
from flexarm.model import Hardware
from flexarm.model.drives.linear import LQGParameters

#: Number of intervals of the preview, its most samples, which take a minute to compute, and its
#: default span times `typical_rate` (rad).
_NODES, _MOST_SAMPLES, _PREVIEWED = 64, 60_000, 3.2


class LQG(LQGParameters, OfArm, Controller):
    """Linear-quadratic feedback of the state of a flexible arm, estimated by a Kalman filter.

    The design uses `linearize` at rest in a posture, sampled exactly. The elastic forces along the
    reference are known in advance, and the preview compensates them optimally.

    In a mechanism the state is that of independent coordinates, and joints that are not
    ``actuated`` have no torque. A base that moves freely is at rest in the nominal motion, and the
    design leaves out its drift with the whole arm; theory page "mechanisms", (M.25), (M.26).

    Attributes:
        designs: the `Design` of each posture of the grid.

    Raises:
        InputError: if a shape, name or number is wrong, ``sample_time`` is too long for the arm,
            ``acceptable`` gives no weight to an undamped mode, a mode is not detectable from
            ``measured``, or a posture needs torques of joints without a motor.
        EquilibriumError: if the arm has no equilibrium at a posture.
    """

    vectorized = analytic = True  # along a reference
    compensates_friction = False
    knows_limits = True
    _unsupported: ClassVar[tuple[str, ...]] = ()
    references: ClassVar[str] = "BrysonHo1975 DoyleStein1981 Maciejowski1985 TahkSpeyer1987"

    _: KW_ONLY
    nominal: Any = Field(
        default=None,
        description="Result of ``simulate`` that replaces the reference as nominal motion.",
    )
    hardware: Hardware | None = Field(default=None, description=OF_DESIGN)

    def __post_init__(self) -> None:
        arm = self.arm
        refuse_both(self)
        self.posture = np.zeros(arm.n_joints) if self.posture is None else np.array(self.posture)
        # The property reads another attribute, which the design sets.
        rate = typical_rate(arm, vars(self)["sample_time"])
        self._scale_defaults(rate)
        self.design_requirements = design_requirements(arm, self, self._regulated(), rate)
        self._grid = PostureGrid(self.posture, self.schedule)
        self._coordinates = self._placed()
        # The constructor leaves the number in the dictionary of the object, under the property.
        self._design_for(vars(self).pop("sample_time"))

    def _placed(self) -> MinimalCoordinates:
        """Return the coordinates of the designs; close the loops of the postures of the grid."""
        refuse_damped_drift(self.arm)
        coordinates = MinimalCoordinates(self.arm, self.actuated, np.asarray(self.posture))
        grid, passive = self._grid, ~coordinates.driven
        self._model = FlexibleModel(self.arm)
        if coordinates.chosen.size == self.arm.dof and np.all(coordinates.driven):
            return coordinates
        self._model = MechanismModel(coordinates)
        grid.postures = coordinates.closed_near(np.asarray(self.posture), grid.postures)
        requirements = self.design_requirements
        world = {"tip"} & {*requirements.measured, *requirements.integrated}
        if coordinates.drifting.size and world:
            hint = "Motors of the joints cannot stop the drift of a free base."
            raise InputError(Problem("measured", "must not contain the tip", hint=hint))
        if np.any(passive) and "joint_angle" in requirements.integrated:
            rule = "is not supported for the angles of joints without a motor"
            raise InputError(Problem("integral", rule, hint="Use integral='tip'."))
        if any(passive[k] for k, *_ in grid.axes):
            raise InputError(Problem("schedule", "is not supported for joints without a motor"))
        return coordinates

    def _scale_defaults(self, rate: float) -> None:
        """Set the defaults that depend on `typical_rate` (rad/s)."""
        if self.preview is None:
            longest = _MOST_SAMPLES * vars(self)["sample_time"]
            self.preview = min(_PREVIEWED / rate, longest)

    def _regulated(self) -> Mapping[str, Any] | None:
        """Return the acceptable deviations that the regulator is designed for; None: defaults."""
        return self.acceptable

    @property  # type: ignore[misc]
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self._sample_time

    @sample_time.setter
    @public_call
    def sample_time(self, value: float) -> None:
        self._design_for(check_positive("sample_time", value))

    def _design_for(self, sample_time: float) -> None:
        """Design the controller of each posture for a sample time (s)."""
        with one_warning():
            check_sample_time(self.arm, sample_time, getattr(self, "bandwidth", None))
            self._sample_time, self._hardware = sample_time, None
            if self.hardware is not None:
                measured = tuple(self.design_requirements.measured)
                self._hardware = LoopHardware(self.hardware, measured, sample_time)
            self.designs = self._design_all()
            self._prepare()

    def _design_all(self) -> tuple[Design, ...]:
        common = self.design_requirements, self._sample_time, self._hardware
        return tuple(design(self._coordinates, posture, *common) for posture in self._grid.postures)

    def _known_force_gain(self, item: Design) -> FloatArray:
        """Return the torque per previewed elastic force, (joints, nodes, forces)."""
        return preview_gain(item, self._previewed, self._stride)

    def _prepare(self) -> None:
        """Compute the arrays that ``update`` uses from the designs."""
        first = self.designs[0]
        self._states, self._outputs = len(first.A), len(first.C)
        self._integrals = len(first.integrated)
        span = self.preview or 0.0
        if span > _MOST_SAMPLES * self._sample_time:
            rule = f"be at most {_MOST_SAMPLES} samples of {self._sample_time:g} s"
            raise InputError(Problem("preview", rule, f"{span:g} s"))
        samples = round(span / self._sample_time)
        self._stride = max(1, -(-samples // _NODES))
        self._previewed = self._stride * (-(-samples // self._stride))
        self._delayed = round(self.delay / self._sample_time)
        self._lead = float(self._delayed)
        signals = measured = tuple(self.design_requirements.measured)
        self._frames: tuple[FloatArray, FloatArray, FloatArray] | None = None
        if self._hardware is not None:
            self._delayed, self._lead = self._hardware.delayed, self._hardware.lead
            signals = self._hardware.signals
            frames = self._hardware.nominal({name: self._size(name) for name in signals})
            self._frames = frames if len(frames[2]) else None
        self._arm_states = 2 * self._coordinates.chosen.size
        self._motor_end = self._states - (0 if self._frames is None else len(self._frames[2]))
        self._places, self._signal_places = self._slices(measured), self._slices(signals)
        self._shown = partial(self._model.readings, signals)
        self._arrays = Interpolated(self._grid, [self._node(item) for item in self.designs])
        self._motion = self._nominal_motion()
        self._joints = self.arm.n_joints
        self.reset()

    def _size(self, name: str) -> int:
        """Return the number of components of a channel that may be measured."""
        return int(self._model.readings((name,), *np.zeros((2, 1, self.arm.dof))).shape[1])

    def _slices(self, names: Sequence[str]) -> dict[str, slice]:
        """Return the places of channels in a row of their components, by name."""
        ends = np.cumsum([self._size(name) for name in names]).tolist()
        return dict(zip(names, map(slice, [0, *ends], ends), strict=False))

    def _node(self, item: Design) -> list[FloatArray]:
        """Return the arrays that are interpolated over posture; (C.22) to (C.27)."""
        kept = np.eye(len(item.A)) - item.estimator @ item.C
        ahead = self._known_force_gain(item)
        corrected, predicted = [kept, item.estimator], [item.A, item.B, item.B_elastic]
        ahead = ahead.reshape(len(ahead), -1)
        return [np.hstack(corrected), item.gain, np.hstack(predicted), ahead]

    @property
    def _steps(self) -> int:
        """Number of samples of the nominal motion to compute, including the current one."""
        return math.ceil(self._lead) + self._previewed + 1

    def _nominal_motion(self) -> PreviewedReference | RecordedRun:
        if self.nominal is not None:
            return RecordedRun(
                self._model, self.nominal, self.sample_time, self._steps, self._shown
            )
        sag = Interpolated(self._grid, [[item.sag] for item in self.designs])
        return PreviewedReference(self._model, sag, self.sample_time, self._steps, self._shown)

    def reset(self) -> None:
        """Clear the estimate, the integrals and the nominal motion."""
        super().reset()
        self._motion.reset()

    def requirements(self, arm: Arm, reference: Reference | None) -> ControllerRequirements:
        first = () if self.nominal is not None else ("joint_angle",)
        requirements = self.design_requirements
        integrated = [name for name in requirements.integrated if name != CHORD]
        read = tuple(dict.fromkeys([*first, *requirements.measured, *integrated]))
        gauges = len(self.arm.gauges) if "strain" in read else None
        return ControllerRequirements(self.arm.n_joints, read, gauges)

    @property
    def estimate(self) -> FloatArray:
        """Deviation (2 dof,) from the nominal motion; of a mechanism's independent coordinates."""
        states = self._arm_states
        return np.array(self.memory.get("estimate", np.zeros(states))[:states])

    def planned(self, t: float, reference: Reference) -> Arrays:
        """Return the nominal motion, and its elastic forces at the nodes of the preview.

        Torques, and the forces of the preview, are those of the time at which the torque acts.
        """
        if self.nominal is None and isinstance(reference, Rest) and reference.angle.ndim > 1:
            rule = "is required for the readings of several runs at the same time"
            raise InputError(Problem("reference", rule))
        nominal, late, forces = self._motion.at(t, reference), self._delayed, self._motion.missing
        inputs = {
            "nominal_angle": nominal.angle,
            "nominal_torque": self._nominal_torques(1)[0],
            "nominal_reading": nominal.shown,
            "nominal_force": forces[late : late + self._previewed + 1 : self._stride],
        }
        if late:
            inputs["coming_force"] = forces[:late]
        if "tip" in self.design_requirements.integrated:
            inputs["nominal_tip"] = self._desired_tip(t, nominal, reference)
        return inputs

    def _nominal_torques(self, count: int) -> FloatArray:
        """Return the nominal torques (count, joints) to request from the current sample on, N m."""
        whole = math.floor(self._lead)
        part = self._lead - whole
        torques = self._motion.torques(whole + count + (part > 0.0))[whole:]
        # Between samples linearly: the motors then reach the nominal torque to second order.
        return torques if part == 0.0 else (1.0 - part) * torques[:-1] + part * torques[1:]

    def initial_memory(self, readings: Measurement, inputs: Arrays) -> Arrays:
        runs = readings[next(iter(self.design_requirements.measured))].shape[:-1]
        start, integral = self._first_state(readings, inputs), np.zeros((*runs, self._integrals))
        state = np.broadcast_to(start, (*runs, self._states))
        memory = {"prediction": state, "estimate": state, "integral": integral}
        if self._delayed:  # requested deviations that do not act yet
            memory["waiting"] = np.zeros((*runs, self._delayed * self._joints))
        if self._hardware is not None:  # its motors have no torque yet
            missing = np.broadcast_to(-inputs["nominal_torque"], (*runs, self._joints))
            before, after = state[..., : self._arm_states], state[..., self._motor_end :]
            motors = (self._motor_end - self._arm_states) // self._joints
            memory["prediction"] = np.concatenate([before, *[missing] * motors, after], axis=-1)
            if self._delayed:
                memory["waiting"] = np.concatenate([missing] * self._delayed, axis=-1)
        if self._frames is not None:
            frames = applied(self._frames[2], inputs["nominal_reading"])
            memory["_frames"] = np.broadcast_to(frames, (*runs, frames.shape[-1]))
        return memory

    def _first_state(self, readings: Measurement, inputs: Arrays) -> FloatArray:
        """Return the deviation of an arm that has its first joint angles and the nominal rates.

        The filter has the gain of its steady state, in which an angle can only be wrong after a
        motion: it would take the distance of the first angles from the reference for large rates.
        """
        places = self._signal_places.get("joint_angle")
        if places is None or "joint_angle" not in self._places:
            return np.zeros(self._states)
        away = readings["joint_angle"] - inputs["nominal_reading"][..., places]
        moved = self._coordinates.chosen[:, None] == self.arm.joint_index
        by_angle = np.zeros((self._states, self._joints))
        by_angle[: len(moved)] = moved
        if self._frames is not None:
            by_angle[self._motor_end :] = self._frames[2][:, places]
        return applied(by_angle, away)

    def step(self, memory: Arrays, readings: Measurement, inputs: Arrays) -> Step:
        arrays = self._arrays.at(inputs["nominal_angle"])
        correct, gain, predict = arrays[:3]
        shown = [readings[name] for name in self.design_requirements.measured]
        inputs, frames = self._nominal_readings(memory, inputs)
        missed = np.concatenate(shown, axis=-1) - inputs["nominal_reading"]
        estimate = applied(correct, np.concatenate([memory["prediction"], missed], axis=-1))
        parts = self._predicted(estimate, memory, predict, inputs), memory["integral"]
        state = np.concatenate(parts, axis=-1)
        nominal, forces = inputs["nominal_torque"], inputs["nominal_force"]
        feedback, more = self._feedback(memory, state, arrays, inputs)
        desired = nominal + feedback
        torque = self._within_limits(desired, memory)
        acting, m = torque - nominal, self._joints
        if self._delayed:
            waiting = np.concatenate([memory["waiting"], acting], axis=-1)
            forces = inputs["coming_force"]
            acting, more = waiting[..., :m], {**more, "waiting": waiting[..., m:]}
        pushed = self._pushed(estimate, acting, forces[0])
        integral = memory["integral"]
        if self._integrals:
            rise = self._rise(readings, inputs)
            request = -applied(gain[:, self._states :], rise)[..., None, :]
            # Do not advance if that would increase a torque at its limit. Without a branch, so
            # that the law is also evaluated over symbols.
            integral = integral + (applied(request, desired - torque) <= 0.0) * rise
        after = {"prediction": applied(predict, pushed), "estimate": estimate, "integral": integral}
        return {**after, **frames, **more}, torque

    def _nominal_readings(self, memory: Arrays, inputs: Arrays) -> tuple[Arrays, Arrays]:
        """Return the inputs with the nominal readings of instruments, and their frames."""
        if self._frames is None:
            return inputs, {}
        by_signal, by_frame, settled = self._frames
        exact = inputs["nominal_reading"]
        both = applied(by_signal, exact) + applied(by_frame, memory["_frames"])
        frames, late = both[..., : len(settled)], both[..., len(settled) :]
        inputs = {**inputs, "nominal_reading": late}
        # Integrals are those of the readings, so that their desired values are late, too.
        if "joint_angle" in self._places:
            inputs["nominal_angle"] = late[..., self._places["joint_angle"]]
        if "nominal_tip" in inputs:
            moved = late[..., self._places["tip"]] - exact[..., self._signal_places["tip"]]
            inputs["nominal_tip"] = inputs["nominal_tip"] + moved
        return inputs, {"_frames": frames}

    def _predicted(
        self, estimate: FloatArray, memory: Arrays, predict: FloatArray, inputs: Arrays
    ) -> FloatArray:
        """Return the deviation at the time when the torque of this sample acts."""
        m = self._joints
        for k in range(self._delayed):
            acting = memory["waiting"][..., k * m : (k + 1) * m]
            estimate = applied(predict, self._pushed(estimate, acting, inputs["coming_force"][k]))
        return estimate

    @staticmethod
    def _pushed(state: FloatArray, torque: FloatArray, force: FloatArray) -> FloatArray:
        """Return a state with its torques and elastic forces, for the prediction of a sample."""
        if state.ndim > 1:  # of many runs, which have one nominal motion
            force = np.broadcast_to(force, (*state.shape[:-1], force.size))
        return np.concatenate([state, torque, force], axis=-1)

    def _feedback(
        self, memory: Arrays, state: FloatArray, arrays: Sequence[FloatArray], inputs: Arrays
    ) -> tuple[FloatArray, Arrays]:
        """Return the torque (joints,) N m added to the nominal one, (C.24), (C.27); more memory."""
        _, gain, _, ahead = arrays[:4]
        return -applied(gain, state) - applied(ahead, inputs["nominal_force"].ravel()), {}

    def _within_limits(self, torque: FloatArray, memory: Arrays) -> FloatArray:
        if self.torque_limit is None:
            return torque
        # ``minimum`` and ``maximum`` take half the time of ``clip``.
        limit: FloatArray = self.torque_limit
        return np.minimum(np.maximum(torque, -limit), limit)

    def _rise(self, readings: Measurement, inputs: Arrays) -> FloatArray:
        """Return the change of the integrals in a sample without limits."""
        (name,) = self.design_requirements.integrated
        if name == CHORD:
            return self.sample_time * self._chord_error(readings, inputs)
        desired = inputs["nominal_angle" if name == "joint_angle" else "nominal_tip"]
        rise: FloatArray = self.sample_time * (readings[name] - desired)
        return rise

    def _chord_error(self, readings: Measurement, inputs: Arrays) -> FloatArray:
        """Return the errors (joints,) of the angles between the chords of the links, rad."""
        chords = self.design_requirements.chords
        assert chords is not None  # the designs integrate the chords
        nominal = inputs["nominal_reading"][..., self._places["strain"]]
        bent = applied(chords, readings.strain - nominal)
        error: FloatArray = readings.joint_angle - inputs["nominal_angle"] + bent
        return error

    def _desired_tip(self, t: float, nominal: Nominal, reference: Reference | None) -> FloatArray:
        """Return the nominal tip (2,), m: of a reference, its own or that of straight links."""
        tip = getattr(reference, "tip", None)
        if self.nominal is None and tip is not None:
            return np.asarray(tip(t))
        bend = nominal.q[self._model.elastic]
        return self._model.tip(nominal.angle, bend if self.nominal is not None else 0.0 * bend)

    @public_call
    def loop_poles(self, plant: Arm | None = None, posture: ArrayLike | None = None) -> FloatArray:
        """Return the poles (k,) of the sampled loop around an arm at rest, 1/s, slowest first.

        Args:
            plant: arm with the same number of joints; None for the model. The state of the loop is
                the state of the plant, the estimate and the integrals, with the ``hardware`` of
                the design.
            posture: (joints,) rad; None for the posture of the design.

        Poles with negative real parts are stable. Poles are ``log(z) / sample_time``, so vibrations
        above half the sampling rate are aliased below it.

        Raises:
            InputError: if ``plant`` has another number of joints, or ``posture`` the wrong shape.
            EquilibriumError: if the plant has no equilibrium at ``posture``.
        """
        arm = self.arm if plant is None else check_kind("plant", plant, Arm)
        if arm.n_joints != self.arm.n_joints:
            rule = f"have the number of joints of the arm ({self.arm.n_joints})"
            raise InputError(Problem("plant", rule, str(arm.n_joints)))
        posture = self.posture if posture is None else posture
        at = check_array("posture", posture, (self.arm.n_joints,))
        with one_warning():
            poles: FloatArray = loop_at(self, plant, at, self.hardware).poles()
        return poles

    @classmethod
    @public_call
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
        rule = "be greater than 0 and less than 2"
        required = check_number("disk_margin", disk_margin, lambda margin: 0.0 < margin < 2.0, rule)
        for name in ("rigidity_uncertainty", "recovery"):
            if name in options:
                rule = "is not supported, because the design searches for it"
                raise InputError(Problem(name, rule))
        arms = [check_kind("arm", arm, Arm), *named_arms(plants).values()]
        best, found = -1.0, (0.0, 0.0)
        with one_warning():
            for unsure, recovery in _TRIED:
                made = cls(arm, posture, rigidity_uncertainty=unsure, recovery=recovery, **options)
                margin = _least(made.at_rest(), arms, postures, best, made.hardware)
                if margin >= required:
                    break
                if margin > best:
                    best, found = margin, (unsure, recovery)
            else:
                hint = (
                    f"Best with rigidity_uncertainty={found[0]:g} and recovery={found[1]:g}. "
                    "Accept larger deviations or less torque, or add gauges."
                )
                rule = f"of {required:g} cannot be reached: the best found is {best:.3g}"
                raise InputError(Problem("disk_margin", rule, hint=hint))
        return made

    def at_rest(self) -> LQG:
        """Return the controller, or a copy without ``nominal`` that keeps the arm at rest."""
        if self.nominal is None:
            return self
        mine = deepcopy(self)
        mine.nominal = None
        mine._motion = mine._nominal_motion()
        return mine


#: Pairs of rigidity uncertainty and recovery, in increasing order of lost performance.
_TRIED = tuple(
    (unsure, recovery) for unsure in (0.0, 0.1, 0.3, 0.6, 1.0) for recovery in (0.0, 0.3, 1.0, 3.0)
)


def _least(
    controller: Controller,
    arms: Sequence[Arm],
    postures: ArrayLike | None,
    enough: float,
    hardware: Hardware | None = None,
) -> float:
    """Return the least disk margin of several arms; stop early once it is at most ``enough``."""
    least = 2.0
    for arm in arms:
        margins = loop_margins(controller, arm, postures, hardware=hardware)
        least = min(least, float(margins.disk_margin.min()))
        if least <= enough:
            break
    return least
