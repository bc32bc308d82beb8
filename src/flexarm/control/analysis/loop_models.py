"""Linear models of the two parts of a sampled loop, with names, for other libraries."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning, warn_of_first
from flexarm.base.arguments import check_kind, check_list_of
from flexarm.base.errors import InputError, Problem, check_frequencies, public_call
from flexarm.control.analysis.margins import (
    check_single_rate,
    loop_at,
    places_of,
    plants_of,
    without_friction,
)
from flexarm.control.analysis.sampled_loop import response
from flexarm.control.contract.base import Controller, Reference, check_reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.state_space import control_system
from flexarm.model import Contact, Hardware

if TYPE_CHECKING:
    import control


@dataclass(frozen=True, eq=False)
class SampledModel:
    """Sampled linear model of small deviations: x+ = A x + B u, y = C x + D u.

    Attributes:
        A, B, C, D: (n, n), (n, inputs), (outputs, n), (outputs, inputs).
        inputs, outputs: names; the units are those of the torques and the readings.
        sample_time: time between samples, s.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_time: float

    def __repr__(self) -> str:
        sizes = f"{len(self.A)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<flexarm.SampledModel: {sizes}, {self.sample_time:g} s>"

    @public_call
    def frequency_response(self, omega: Any) -> NDArray[np.complex128]:
        """Return the response to harmonic inputs, (frequencies, outputs, inputs), complex.

        Args:
            omega: (frequencies,) rad/s, or one number, whose response is (outputs, inputs).

        Raises:
            InputError: if ``omega`` is not a finite number or an array of them.
        """
        omega = check_frequencies(omega)
        z = np.exp(1j * self.sample_time * np.atleast_1d(omega))
        values = (response(self.A, self.B, self.C, z) + self.D).astype(np.complex128)
        return values if omega.ndim else values[0]

    @public_call
    def to_control(self) -> control.StateSpace:
        """Convert to a sampled state-space system of python-control with the same names.

        Raises:
            InputError: if python-control is not installed.
        """
        return control_system(self, dt=self.sample_time)


class LoopModels(NamedTuple):
    """The two parts of a sampled loop: the loop is closed with positive feedback.

    Attributes:
        plant: from the requested torques to the readings, with hold, motors and instruments.
        controller: from the readings to the requested torques.
    """

    plant: SampledModel
    controller: SampledModel


@public_call
def loop_models(
    controller: Controller,
    plant: Arm | None = None,
    posture: ArrayLike | None = None,
    *,
    hardware: Hardware | None = None,
    contacts: Sequence[Contact] = (),
    reference: Reference | None = None,
) -> LoopModels:
    """Return the linear models of a controller and of the sampled arm that it controls.

    They are the models that `loop_margins` uses. The sign of the controller includes that of the
    feedback: ``control.feedback(plant, controller, sign=1)`` is the closed loop.

    Args:
        controller: a controller with a ``step`` that can be linearised, as all built-in ones except
            `EstimatorController`, `NonlinearMPC`, `RBFAdaptive` and `RepetitiveControl`.
        plant: the arm; None for the model of the controller.
        posture: (joints,) rad; None for the first posture of the design, or zeros if the
            controller has none. With a ``reference``, its time (s) instead; None for its start.
        hardware: instruments and motors; None for exact ones.
        contacts: surfaces; those in contact with the arm at rest belong to the plant, without
            friction.
        reference: motion that presses (`pressed_motion`), for the force controllers.

    Raises:
        InputError: if the controller has no ``step``, an instrument has its own
            ``sample_time``, or an argument has the wrong shape.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        LargeDeflectionWarning: if a link of the arm bends too far at rest.
    """
    if plant is not None:
        check_kind("plant", plant, Arm)
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    contacts = check_list_of("contacts", contacts, Contact)
    if reference is not None:
        check_reference(reference)
    (arm,) = plants_of(controller, plant, "plant").values()
    places = places_of(controller, arm, posture, reference, "posture")
    if posture is not None and len(places) > 1:
        rule = "be one posture, or one time of the reference"
        raise InputError(Problem("posture", rule, f"{len(places)} of them"))
    t, angles = places[0]
    bare = without_friction(contacts)
    with one_warning() as bent:
        loop = loop_at(controller, arm, angles, hardware, bare, reference, t)
    warn_of_first(bent)
    check_single_rate(loop)
    torques = tuple(f"torque[{number}]" for number in arm.joint_numbers)
    A, B, C, _ = loop.plant[:4]
    readings = loop.plant.outputs
    through = np.zeros((len(readings), len(torques)))
    return LoopModels(
        SampledModel(A[0], B, C[0], through, torques, readings, loop.sample_time),
        SampledModel(*loop.controller, readings, torques, loop.sample_time),
    )
