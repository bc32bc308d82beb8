"""Linear models of an arm between the samples of a loop, and loops with them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm, turning_joints
from flexarm.base.arguments import check_posture
from flexarm.base.errors import kept_warnings, warn_caller
from flexarm.base.late import linalg
from flexarm.control.analysis.linear_controller import (
    FrozenReference,
    LinearController,
    linear_controller,
)
from flexarm.control.contract.base import Controller, Reference, around
from flexarm.control.design.minimal import (
    MinimalCoordinates,
    sliding_rate,
    without_dry_friction,
)
from flexarm.control.hardware.measurement import FloatArray, faulty
from flexarm.control.hardware.sampled_plant import Reading, SampledPlant, Signal, sampled_plant
from flexarm.linear.models.state_space import OutputName, balanced, component_places
from flexarm.model import Contact, Hardware, Instrument, InstrumentFault, Sensor

#: Models of an arm that are kept.
_KEPT = 64

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
        self._shape = len(C), B.shape[1]
        if not len(A):
            self._T = self._B = self._C = np.zeros((0, 0), dtype=complex)
            return
        A, scale = balanced(A)
        self._T, Z = linalg.schur(A, output="complex")
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
