"""Linear models of an arm between the samples of a loop, and loops with them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm, turning_joints
from flexarm.base.arguments import check_posture
from flexarm.base.errors import InputError, Problem, kept_warnings, warn_caller
from flexarm.control.analysis.linear_controller import (
    FrozenReference,
    LinearController,
    linear_controller,
)
from flexarm.control.contract.base import Controller, Reference, around
from flexarm.control.design.linear_design import held
from flexarm.control.design.minimal import (
    MinimalCoordinates,
    sliding_rate,
    without_dry_friction,
)
from flexarm.control.hardware.measurement import FloatArray, faulty, filter_of, stride_and_delay
from flexarm.linear.models.state_space import OutputName, component_places
from flexarm.model import Contact, Hardware, Instrument, InstrumentFault, Motors, Sensor

#: Largest number of states, and largest period (samples) after which all instruments repeat.
_MOST_STATES, _MOST_SAMPLES = 1000, 300

#: Models of an arm that are kept.
_KEPT = 64

#: Tolerance for delays of whole samples, because decimal fractions are rounded.
_GRID = 1e-9


class Signal(NamedTuple):
    """Linear signal of an arm: value + C x + D (acting torque).

    ``components`` are the ends of the names of its components, such as ``[1]``; empty if unused.
    """

    value: FloatArray
    C: FloatArray
    D: FloatArray
    components: tuple[str, ...] = ()


#: Instrument and its signal, with the factors of its faults.
Reading = tuple[Instrument, Signal]
#: Place in the state, number of frames, and size of each, of the memory of an instrument.
Slot = tuple[int, int, int]


class SampledPlant(NamedTuple):
    """Sampled linear system X+ = A X + B u, y = C X, with u the torque of the controller.

    The state X consists of the states of the arm, the motors and the instruments. A and C are
    periodic sequences of matrices; they have one entry unless an instrument has its own sample
    time. ``outputs`` are the names of the components of y.
    """

    A: list[FloatArray]
    B: FloatArray
    C: list[FloatArray]
    sample_time: float
    outputs: tuple[str, ...] = ()


def sampled_plant(
    A: FloatArray, B: FloatArray, readings: list[Reading], motors: Motors | None, sample_time: float
) -> SampledPlant:
    """Sample a linear arm x' = A x + B (acting torque) exactly, with its hardware.

    The model includes delays, the motors' lag, and the frames and filtered rates of instruments. It
    excludes nonlinear effects (limits, resolution) and noise.
    """
    motors = motors or Motors()
    m, lag = B.shape[1], motors.time_constant
    if lag > 0.0:  # the acting torque is a state that follows the requested one
        rows = np.hstack([np.zeros((m, len(A))), -np.eye(m) / lag])
        A, B = np.vstack([np.hstack([A, B]), rows]), np.vstack([np.zeros_like(B), np.eye(m) / lag])
    late, part = _delay(motors.delay, sample_time)
    before, push_before = held(A, B, part * sample_time)
    after, push_after = held(A, B, (1.0 - part) * sample_time)
    past = late + 1  # torques requested before this sample
    slots = [_slots(reading, sample_time) for reading in readings]
    n = len(A)
    starts = n + m * past + np.cumsum([0, *(count * width for count, width in slots)])
    size = int(starts[-1])
    period = math.lcm(*(stride_and_delay(item, sample_time)[0] for item, _ in readings))
    if size > _MOST_STATES or period > _MOST_SAMPLES:
        rule = f"repeat within {_MOST_SAMPLES} samples and have at most {_MOST_STATES} states"
        value = f"{period} samples and {size} states"
        hint = "Use sample times with a smaller common multiple, or shorter delays."
        raise InputError(Problem("the sampled plant", rule, value, hint))
    # Entry j selects the torque requested j samples ago. That of the current sample is the input.
    commands = [np.zeros((m, size)), *(_places(m, n + m * j, size) for j in range(past))]
    step, push = np.zeros((size, size)), np.zeros((size, m))
    step[:n, :n] = after @ before
    step[:n] += after @ push_before @ commands[late + 1] + push_after @ commands[late]
    if late == 0:
        push[:n] = push_after
    push[n : n + m] = np.eye(m)
    for j in range(1, past):
        step[n + m * j : n + m * (j + 1)] = commands[j]
    acting = _places(m, n - m, size) if lag > 0.0 else commands[late + 1]
    steps, outputs = [], []
    for k in range(period):
        now, shown = step.copy(), []
        for reading, start, slot in zip(readings, starts.tolist(), slots, strict=False):
            signal = reading[1]
            exact = signal.D @ acting
            exact[:, : signal.C.shape[1]] += signal.C
            shown.append(_read(reading[0], exact, now, (start, *slot), k, sample_time))
        steps.append(now)
        outputs.append(np.vstack(shown) if shown else np.zeros((0, size)))
    names = tuple(
        label + end
        for item, signal in readings
        for label in item.labels
        for end in signal.components
    )
    return SampledPlant(steps, push, outputs, sample_time, names)


def _delay(delay: float, sample_time: float) -> tuple[int, float]:
    """Return the whole samples of a delay, and the remaining fraction of a sample."""
    late = math.floor(delay / sample_time + _GRID)
    part = delay / sample_time - late
    return late, part if part > _GRID else 0.0


def _places(count: int, start: int, size: int) -> FloatArray:
    """Return rows that select ``count`` numbers of a state of length ``size``."""
    return np.eye(size)[start : start + count]


def _slots(reading: Reading, sample_time: float) -> tuple[int, int]:
    """Return the number of earlier frames that an instrument stores, and the size of each."""
    every, late = stride_and_delay(reading[0], sample_time)
    filtered = reading[0].rate_cutoff is not None
    count = max(late, 1) if filtered or every > 1 else late
    return count, len(reading[1].C) * (1 + filtered)


def _read(
    item: Instrument, exact: FloatArray, step: FloatArray, slot: Slot, tick: int, sample_time: float
) -> FloatArray:
    """Return the rows of a reading over the state; write its memory into ``step``."""
    (start, count, width), (every, late) = slot, stride_and_delay(item, sample_time)
    p, size = len(exact), exact.shape[1]
    if tick % every:  # without a new frame, the last one remains
        frame = _places(width, start, size)
    elif item.rate_cutoff is None:
        frame = exact
    else:
        forget, per_change = filter_of(item.rate_cutoff, every * sample_time)
        last, rate = _places(p, start, size), _places(p, start + p, size)
        frame = np.vstack([exact, forget * rate + per_change * (exact - last)])
    if count:
        step[start : start + width] = frame
        for first in range(start, start + (count - 1) * width, width):
            step[first + width : first + 2 * width] = _places(width, first, size)
    return frame if late == 0 else _places(width, start + (late - 1) * width, size)


ComplexArray = NDArray[Any]
#: Multipliers below this are zero except for rounding.
_NONE = 1e-9


@dataclass(frozen=True, eq=False)
class SampledLoop:
    """Sampled loop of a linear controller and a linear arm with its motors and instruments.

    Attributes:
        plant, controller: the two parts. The output of the plant is the measurement of the
            controller.
    """

    plant: SampledPlant
    controller: LinearController

    @property
    def sample_time(self) -> float:
        """Time between samples, s."""
        return self.plant.sample_time

    def matrices(self) -> list[FloatArray]:
        """Return the state matrices of (plant, controller) for each sample of a period."""
        A, B, C, D = self.controller
        P, push = self.plant.A, self.plant.B
        return [
            np.block([[now + push @ D @ seen, push @ C], [B @ seen, A]])
            for now, seen in zip(P, self.plant.C, strict=True)
        ]

    def multipliers(self) -> ComplexArray:
        """Return the eigenvalues (k,) of the loop over one sample, largest magnitude first."""
        maps = self.matrices()
        z = np.linalg.eigvals(reduce(lambda done, now: now @ done, maps)).astype(complex)
        z = z ** (1.0 / len(maps))
        return np.asarray(z[np.argsort(-np.abs(z))])

    def poles(self) -> ComplexArray:
        """Return the poles (k,), 1/s, slowest decay first: ``log(z) / sample_time``."""
        z = self.multipliers()
        # Multipliers of zero have no pole. They belong to states that no later sample uses.
        return np.asarray(np.log(z[np.abs(z) > _NONE]) / self.sample_time)

    def sensitivity(self, z: ComplexArray) -> ComplexArray:
        """Return the input sensitivity (f, joints, joints) at points z (f,) of the complex plane.

        This is the transfer function from a torque added at the motors to the acting torque. It
        requires instruments with the sample time of the controller.
        """
        of_plant, of_controller = self._responses
        loop = -(of_controller(z) + self.controller.D) @ of_plant(z)
        try:
            found: ComplexArray = np.linalg.inv(np.eye(loop.shape[-1]) + loop)
        except np.linalg.LinAlgError:  # a pole of the loop at one of the points
            found = np.full(loop.shape, np.inf + 0j)
            regular = np.linalg.matrix_rank(np.eye(loop.shape[-1]) + loop) == loop.shape[-1]
            found[regular] = np.linalg.inv((np.eye(loop.shape[-1]) + loop)[regular])
        return found

    @cached_property
    def _responses(self) -> tuple[Response, Response]:
        """Responses of the plant and of the controller."""
        A, B, C, _ = self.controller
        return Response(self.plant.A[0], self.plant.B, self.plant.C[0]), Response(A, B, C)


class Response:
    """Frequency response C (z - A)^-1 B of a linear system, for many points z.

    By the complex Schur form A = Z T Z^H of the balanced matrix: then each point costs a back
    substitution instead of a factorisation. A. J. Laub, Efficient multivariable frequency response
    computations, IEEE Transactions on Automatic Control 26 (1981) 407-408, uses the Hessenberg form
    likewise.
    """

    def __init__(self, A: FloatArray, B: FloatArray, C: FloatArray) -> None:
        from scipy.linalg import matrix_balance, schur

        self._shape = len(C), B.shape[1]
        if not len(A):
            self._T = self._B = self._C = np.zeros((0, 0), dtype=complex)
            return
        A, (scale, _) = matrix_balance(A, permute=False, separate=True)
        self._T, Z = schur(A, output="complex")
        self._B, self._C = Z.conj().T @ (B / scale[:, None]), (C * scale) @ Z

    def __call__(self, z: ComplexArray) -> ComplexArray:
        """Return the response (f, outputs, inputs) at points z (f,); not finite at poles."""
        rows, columns = self._shape
        if not len(self._T):
            return np.zeros((len(z), rows, columns), dtype=complex)
        states = np.repeat(self._B, len(z), axis=1)  # (states, inputs times points)
        points = np.tile(z, columns)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for k in range(len(self._T) - 1, -1, -1):
                states[k] += self._T[k, k + 1 :] @ states[k + 1 :]
                states[k] /= points - self._T[k, k]
            found = (self._C @ states).reshape(rows, columns, len(z))
        return np.ascontiguousarray(np.moveaxis(found, -1, 0))


#: Factors on the rate, and weights of a mean that cancels terms of first to third order.
_RATES = ((1.0, 2.0 / 3.0), (-1.0, 2.0 / 3.0), (2.0, -1.0 / 6.0), (-2.0, -1.0 / 6.0))


class PlantModel(NamedTuple):
    """Linear model of deviations x of (q, qd), x' = A x + B (acting torque), and its signals."""

    A: FloatArray
    B: FloatArray
    signals: dict[OutputName, Signal]


def sliding(
    controller: object, reference: Reference | None, *arms: Arm
) -> tuple[float, tuple[Arm, ...]]:
    """Remove dry friction, unless the controller models it and there is no ``reference``.

    Linearised at zero rate, regularised dry friction is a viscous damper of about a hundred times
    its torque per rad/s, which moving joints do not have. Therefore the arms have no dry friction,
    and a controller that compensates friction is linearised at joint rates where dry friction is
    constant. Return this rate (rad/s), zero if the controller's model has no dry friction, and the
    arms.
    """
    laws = (law for law in around(controller) if getattr(law, "compensates_friction", True))
    believed = [getattr(law, "arm", None) for law in laws]
    rate = max([0.0, *(sliding_rate(arm) for arm in believed if isinstance(arm, Arm))])
    if rate > 0.0 and reference is None:
        return 0.0, arms
    return rate, tuple(map(without_dry_friction, arms))


def instruments_of(arm: Arm, hardware: Hardware | None, contacts: int) -> list[Instrument]:
    """Return the instruments of a run: those of ``hardware``, or exact ones without it."""
    if hardware is not None and hardware.instruments is not None:
        return list(hardware.instruments)
    names = ["joint_angle", "joint_rate"]
    names += ["strain"] * bool(arm.gauges) + ["contact_force"] * (contacts > 0)
    return [Instrument(signal=name) for name in names]


def signals_of(instruments: Sequence[Instrument]) -> list[OutputName]:
    """Return the signals of instruments without duplicates."""
    return list(dict.fromkeys(item.output for item in instruments))


def model_at(
    arm: Arm,
    posture: ArrayLike,
    signals: Sequence[OutputName],
    contacts: Sequence[Contact] = (),
    actuated: Sequence[int] | None = None,
) -> PlantModel:
    """Linearise an arm at rest in a posture (joints,) rad; without the drift of a free base.

    Joints that are not ``actuated`` have no torque.
    """
    angles = check_posture("posture", posture, arm.n_joints, turning_joints(arm))
    joints = None if actuated is None else tuple(actuated)
    model, warnings = _models(arm)(tuple(angles), tuple(signals), tuple(contacts), joints)
    for text, kind in warnings:
        warn_caller(text, kind)
    return model


@once_per_arm
def _models(arm: Arm) -> Callable[..., tuple[PlantModel, list[Any]]]:
    """Return `_model` for an arm, which keeps its last results."""
    return lru_cache(_KEPT)(partial(_model, arm))


def _model(
    arm: Arm,
    posture: tuple[float, ...],
    signals: tuple[OutputName, ...],
    contacts: tuple[Contact, ...],
    actuated: tuple[int, ...] | None,
) -> tuple[PlantModel, list[Any]]:
    """Return the model of `model_at`, with its warnings."""
    warnings: list[Any] = []
    try:
        with kept_warnings() as warnings:
            angles = np.array(posture)
            coordinates = MinimalCoordinates(arm, actuated, angles, contacts)
            rest = coordinates.at_rest(coordinates.closed(angles), contacts)
            model = coordinates.linearized(rest, ("torque",), signals)
    except Exception:
        for text, kind in warnings:
            warn_caller(text, kind)
        raise
    found: dict[OutputName, Signal] = {}
    for signal in signals:
        names = signal.labels() if isinstance(signal, Sensor) else [signal]
        rows = component_places(model.outputs, names)
        ends = tuple("".join(model.outputs[k].rpartition("[")[1:]) for k in rows)
        found[signal] = Signal(model.output[rows], model.C[rows], model.D[rows], ends)
    return PlantModel(model.A, model.B * coordinates.driven, found), warnings


def loop_of(
    controller: Controller,
    model: PlantModel,
    instruments: Sequence[Instrument],
    hardware: Hardware | None,
    reference: Reference | None = None,
    t: float = 0.0,
    believed: PlantModel | None = None,
    rate: float = 0.0,
) -> SampledLoop:
    """Close the loop of a law around a linear arm.

    The controller is linearised about the readings of its own model ``believed``, by default
    ``model``, and about the force that the ``reference`` requests. Errors are zero there, and no
    limit of torques or integrals is active. Gain faults and frozen readings of instruments, from
    the start of a run to its end, are factors of the readings of ``model``.

    Args:
        rate: rate of all joints (rad/s), see `sliding`. The derivatives of Coriolis and centrifugal
            torques, proportional to the rate and its square, cancel in a mean over several rates.
    """
    about = model if believed is None else believed
    measured: dict[str, FloatArray] = {}
    names: dict[str, OutputName] = {}
    for item in instruments:
        value = about.signals[item.output].value
        if item.signal == "contact_force":
            value = value.reshape(-1, 2).copy()
            requested: Any = reference
            if hasattr(requested, "contact_force"):
                value[0] = requested.contact_force(t) * requested.normal(t)
        labels = item.labels
        measured[labels[0]], names[labels[0]] = value, item.output
        if len(labels) > 1:
            measured[labels[1]], names[labels[1]] = np.zeros_like(value), f"{item.signal}_rate"
    motors = hardware.motors if hardware is not None else None
    readings = [_reading(item, model.signals[item.output]) for item in instruments]
    plant = sampled_plant(model.A, model.B, readings, motors, controller.sample_time)
    if rate == 0.0 or reference is None:
        return SampledLoop(plant, linear_controller(controller, measured, reference, t, names))
    turning = {  # the readings of joint rates, also of those from filtered angles
        item.labels[-1]
        for item in instruments
        if item.signal == "joint_rate" or (item.signal == "joint_angle" and len(item.labels) > 1)
    }
    terms = []
    for factor, weight in _RATES:
        now = {k: v + factor * rate if k in turning else v for k, v in measured.items()}
        moving = FrozenReference(reference, t, factor * rate)
        slopes = linear_controller(controller, now, moving, t, names)
        terms.append([weight * slope for slope in slopes])
    mean = LinearController(*(np.sum(slope, axis=0) for slope in zip(*terms, strict=True)))
    return SampledLoop(plant, mean)


def _reading(item: Instrument, signal: Signal) -> Reading:
    """Return the reading of a signal, with the gains that faults give it during the whole run."""
    gains = [
        one if one.kind == "gain" else InstrumentFault("gain", 0.0, channel=one.channel)
        for one in item.faults
        if one.kind in ("gain", "frozen") and one.start == 0.0 and one.end is None
    ]
    shape = (-1, 2) if item.signal == "contact_force" else (-1,)
    factor = faulty(np.ones(len(signal.C)).reshape(shape), gains, 0.0).reshape(-1, 1)
    return item, signal._replace(C=factor * signal.C, D=factor * signal.D)
