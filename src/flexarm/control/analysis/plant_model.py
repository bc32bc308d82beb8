"""Linear model of an arm in a loop, with all measured signals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.control.analysis.linear_controller import (
    FrozenReference,
    LinearController,
    linear_controller,
)
from flexarm.control.analysis.sampled_loop import SampledLoop
from flexarm.control.analysis.sampled_plant import Reading, sampled_plant
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.instruments import faulty
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import OutputName
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.model import Contact, Friction, Hardware, Instrument, InstrumentFault, Sensor

#: Factors on the rate, and weights of a mean that cancels terms of first to third order.
_RATES = ((1.0, 2.0 / 3.0), (-1.0, 2.0 / 3.0), (2.0, -1.0 / 6.0), (-2.0, -1.0 / 6.0))


class Signal(NamedTuple):
    """Linear signal of an arm: value + C x + D (acting torque).

    ``components`` are the ends of the names of its components, such as ``[1]``; empty if unused.
    """

    value: FloatArray
    C: FloatArray
    D: FloatArray
    components: tuple[str, ...] = ()


class PlantModel(NamedTuple):
    """Linear model of deviations x of (q, qd), x' = A x + B (acting torque), and its signals."""

    A: FloatArray
    B: FloatArray
    signals: dict[OutputName, Signal]


class Sliding(NamedTuple):
    """Conditions of sliding joints for the analysis of a loop.

    Linearised at zero rate, regularised dry friction is a viscous damper of about a hundred times
    its torque per rad/s, which moving joints do not have. Therefore the arms have no dry friction,
    and a controller that compensates friction is linearised at joint rates where dry friction is
    constant.

    Attributes:
        rate: joint rate (rad/s) at which the controller is linearised, zero if its model has no dry
            friction.
        arms: as given, without Coulomb and static friction.
    """

    rate: float
    arms: tuple[Arm, ...]


def sliding(controller: object, reference: Reference | None, *arms: Arm) -> Sliding:
    """Remove dry friction, unless the controller models it and there is no ``reference``."""
    believed, inner = [], controller
    while inner is not None:
        believed.append(getattr(inner, "arm", None))
        inner = getattr(inner, "inner", None)
    rate = max([0.0, *(_sliding_rate(arm) for arm in believed if isinstance(arm, Arm))])
    if rate > 0.0 and reference is None:
        return Sliding(0.0, arms)
    free = {id(arm): _without_dry_friction(arm) for arm in arms}
    return Sliding(rate, tuple(free[id(arm)] for arm in arms))


def _sliding_rate(arm: Arm) -> float:
    """Return a rate (rad/s) above which dry friction is constant to 1e-7, or zero without it."""
    every = [joint.friction for joint in arm.spec.joints if joint.friction is not None]
    rates = [(10.0 * one.model_rate, 4.0 * one.stribeck_rate) for one in every if _is_dry(one)]
    return max((max(pair) for pair in rates), default=0.0)


def _is_dry(friction: Friction) -> bool:
    return any((friction.coulomb, friction.static, friction.coulomb_negative))


def _without_dry_friction(arm: Arm) -> Arm:
    """Return an arm with viscous friction only; the same object if there is no dry friction."""
    if not _sliding_rate(arm):
        return arm
    dry = {"coulomb": 0.0, "static": None, "coulomb_negative": None}
    dry |= {"bristle_stiffness": None, "bristle_damping": 0.0}
    joints = [
        joint.replace(friction=joint.friction.replace(**dry))
        if joint.friction is not None
        else joint
        for joint in arm.spec.joints
    ]
    return Arm(arm.spec.replace(joints=joints))


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
) -> PlantModel:
    """Linearise an arm at rest in a posture (joints,) rad.

    Raises:
        InputError: if the arm does not have a signal.
        EquilibriumError: if the arm has no equilibrium at the posture.
    """
    rest = equilibrium(arm, posture, contacts=contacts)
    model = linearize(arm, rest, outputs=signals)
    found: dict[OutputName, Signal] = {}
    for signal in signals:
        names = signal.labels() if isinstance(signal, Sensor) else [signal]
        rows = [
            k
            for k, label in enumerate(model.outputs)
            if any(label == name or label.startswith(f"{name}[") for name in names)
        ]
        ends = tuple("".join(model.outputs[k].rpartition("[")[1:]) for k in rows)
        found[signal] = Signal(model.output[rows], model.C[rows], model.D[rows], ends)
    return PlantModel(model.A, model.B, found)


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
        rate: rate of all joints (rad/s), see `Sliding`. The derivatives of Coriolis and centrifugal
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
    turning = {item.labels[-1] for item in instruments if _is_rate(item)}
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
    return Reading(item, factor * signal.C, factor * signal.D, signal.components)


def _is_rate(item: Instrument) -> bool:
    """Return whether the last reading of an instrument is a joint rate."""
    filtered = item.signal == "joint_angle" and len(item.labels) > 1
    return filtered or item.signal == "joint_rate"
