"""The linear arm in a loop: about a posture, with a reading of every signal that is measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.contacts import Contact
from flexarm.control.base import Controller, Reference
from flexarm.control.hardware import Hardware
from flexarm.control.instruments import Instrument
from flexarm.control.linear_controller import linear_controller
from flexarm.control.measurement import FloatArray
from flexarm.control.sampled_loop import SampledLoop
from flexarm.control.sampled_plant import Reading, sampled_plant
from flexarm.linear.equilibrium import equilibrium
from flexarm.linear.linearize import linearize
from flexarm.linear.signals import OutputName, Sensor


class Signal(NamedTuple):
    """A signal of a linear arm: value + C x + D (acting torque)."""

    value: FloatArray
    C: FloatArray
    D: FloatArray


class PlantModel(NamedTuple):
    """Small deviations x of (q, qd): x' = A x + B (acting torque), and the signals measured."""

    A: FloatArray
    B: FloatArray
    signals: dict[OutputName, Signal]


def instruments_of(arm: Arm, hardware: Hardware | None, contacts: int) -> list[Instrument]:
    """Return the instruments of a run: those of the hardware, or the exact ones without it."""
    if hardware is not None and hardware.instruments is not None:
        return list(hardware.instruments)
    names = ["joint_angle", "joint_rate"]
    names += ["strain"] * bool(arm.gauges) + ["contact_force"] * (contacts > 0)
    return [Instrument(name) for name in names]


def signals_of(instruments: Sequence[Instrument]) -> list[OutputName]:
    """Return the signals of instruments, each once."""
    return list(dict.fromkeys(item.signal for item in instruments))


def model_at(
    arm: Arm,
    posture: ArrayLike,
    signals: Sequence[OutputName],
    contacts: Sequence[Contact] = (),
) -> PlantModel:
    """Linearise an arm at rest in a posture (joints,) rad.

    Raises:
        InputError: if a signal is not on the arm.
        EquilibriumError: if the arm has no rest there.
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
        found[signal] = Signal(model.output[rows], model.C[rows], model.D[rows])
    return PlantModel(model.A, model.B, found)


def loop_of(
    controller: Controller,
    model: PlantModel,
    instruments: Sequence[Instrument],
    hardware: Hardware | None,
    reference: Reference | None = None,
    t: float = 0.0,
    believed: PlantModel | None = None,
) -> SampledLoop:
    """Close the loop of a controller that declares its memory around a linear arm.

    The controller is linearised about the readings of the model that it believes in, by default
    the same, and about the force that the ``reference`` requests: errors are zero there, and no
    limit of torques or integrals is reached.
    """
    about = model if believed is None else believed
    measured: dict[str, FloatArray] = {}
    for item in instruments:
        value = about.signals[item.signal].value
        if item.signal == "contact_force":
            value = value.reshape(-1, 2).copy()
            asked: Any = reference
            if hasattr(asked, "contact_force"):
                value[0] = asked.contact_force(t) * asked.normal(t)
        labels = item.labels
        measured[labels[0]] = value
        if len(labels) > 1:
            measured[labels[1]] = np.zeros_like(value)
    motors = hardware.motors if hardware is not None else None
    readings = [
        Reading(item, model.signals[item.signal].C, model.signals[item.signal].D)
        for item in instruments
    ]
    plant = sampled_plant(model.A, model.B, readings, motors, controller.sample_time)
    return SampledLoop(plant, linear_controller(controller, measured, reference, t))
