"""Trials of a motion that is learned, by simulation or on a bench."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_positive
from flexarm.base.errors import FlexarmError, InputError, Problem, check_array, shown
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model import Hardware
from flexarm.motion.geometry.chain import rigid_chain
from flexarm.motion.geometry.kinematics import tip_jacobian
from flexarm.planning.learning.added_torque import AddedTorque
from flexarm.planning.learning.lifted import Window, lifted_model
from flexarm.simulation.calls.metrics import tip_reference
from flexarm.simulation.calls.run import simulate

if TYPE_CHECKING:
    import xarray as xr

#: Intervals by default, and largest number of learned torques: the model is a dense matrix, and its
#: eigenvalues take the third power of that number, a minute for the largest.
_INTERVALS, _MOST = 400, 4000
#: Difference from a whole number that is rounding.
_ROUNDING = 1e-6


class Bench:
    """Trials of a motion, by simulation or on a bench, and the linear model of a trial."""

    def __init__(
        self,
        arm: Arm,
        reference: Reference,
        window: Window,
        output: str,
        plant: Arm | None,
        hardware: Hardware | None,
        trial: Callable[[Controller], ArrayLike] | None,
        options: dict[str, Any],
    ) -> None:
        self.arm, self.reference, self.window, self.output = arm, reference, window, output
        self._plant, self._hardware, self._trial = plant, hardware, trial
        self._options = options
        self._count = 0
        if output == "tip":
            self._wanted = tip_reference(arm, reference, window.ends)
        else:
            self._wanted = np.array([reference.joint_angle(float(t)) for t in window.ends])
        self.result: xr.Dataset | None = None

    def model(self, controller: AddedTorque) -> FloatArray:
        """Return the lifted model (N p, N joints) of the chosen output."""
        # Loads and changes are not part of the model.
        result = self._simulate(controller, None, None, self._start())
        tip, angle = lifted_model(self.arm, controller, self.reference, result, self.window)
        chosen = tip if self.output == "tip" else angle
        size = self.window.intervals
        return chosen.reshape(size * chosen.shape[1], size * self.arm.joints)

    def errors(self, controller: AddedTorque) -> FloatArray:
        """Return the errors (N, p) of the next trial."""
        if self._trial is not None:
            try:
                given = self._trial(controller)
            except FlexarmError:
                raise
            except Exception as error:
                words = " ".join(str(error).split())
                failure = Problem("trial", f"failed with {type(error).__name__}: {words}")
                raise InputError(failure) from error
            return self._wanted - check_array("trial", given, self._wanted.shape)
        hardware = self._hardware
        if hardware is not None:
            hardware = hardware.replace(seed=hardware.seed + self._count)
        self._count += 1
        self.result = result = self._simulate(controller, self._plant, hardware, self._options)
        reading = f"measured_{self.output}"
        values = result[reading if reading in result else self.output].values
        ends = self.window.stride * np.arange(1, self.window.intervals + 1)
        found: FloatArray = self._wanted - values[ends, : self._wanted.shape[1]]
        return found

    def _start(self) -> dict[str, Any]:
        """Return the initial state of the trials in coordinates of the model."""
        found: dict[str, Any] = {}
        plant = self._plant
        for name in ("initial", "initial_rate"):
            value = self._options.get(name)
            if value is not None and plant is not None and plant.dof != self.arm.dof:
                # Coordinates of the bending differ, so the links of the model start straight.
                given = check_array(name, value, (plant.dof,))
                value = self.arm.rest(given[plant.joint_index])
            found[name] = value
        return found

    def _simulate(
        self,
        controller: AddedTorque,
        plant: Arm | None,
        hardware: Hardware | None,
        options: dict[str, Any],
    ) -> xr.Dataset:
        # One sample more than the trial, because the readings of its end are taken there.
        sample_time = self.window.sample_time
        return simulate(
            self.arm,
            (self.window.intervals * self.window.stride + 1) * sample_time,
            controller=controller,
            reference=self.reference,
            plant=plant,
            hardware=hardware,
            rate=1.0 / sample_time,
            **{"progress": False, **options},
        )


def window_of(
    arm: Arm,
    reference: Reference,
    controller: Controller,
    duration: float | None,
    interval: float | None,
) -> Window:
    """Divide a trial into intervals."""
    sample_time = check_positive("controller.sample_time", controller.sample_time)
    end = getattr(reference, "end_time", None)
    until = end if duration is None else duration
    if until is None:
        raise InputError(Problem("duration", "is required, because the reference has no end_time"))
    samples = check_positive("duration", until) / sample_time
    if end is not None and until < end * (1.0 - _ROUNDING):
        rule = f"be at least the end of the reference, {end:.6g} s"
        raise InputError(Problem("duration", rule, shown(duration)))
    if interval is None:
        stride = max(1, math.ceil(samples / _INTERVALS * (1.0 - _ROUNDING)))
    else:
        given = check_positive("interval", interval) / sample_time
        stride = round(given)
        if stride < 1 or abs(given - stride) > _ROUNDING * stride:
            rule = f"be a multiple of the controller's sample time of {sample_time:.6g} s"
            raise InputError(Problem("interval", rule, shown(interval)))
    count = math.floor(samples / stride * (1.0 + _ROUNDING))
    if count < 2 or count * arm.joints > _MOST:
        rule = f"be divided into 2 to {_MOST // arm.joints} intervals"
        raise InputError(Problem("duration", rule, str(count), "Choose another interval."))
    return Window(sample_time, stride, count)


def joint_errors(arm: Arm, reference: Reference, window: Window, output: str) -> FloatArray:
    """Return the joint errors per error of the output, (N, joints, p)."""
    if output == "joint_angle":
        return np.broadcast_to(np.eye(arm.joints), (window.intervals, arm.joints, arm.joints))
    chain = rigid_chain(arm)
    angles = np.array([reference.joint_angle(float(t)) for t in window.ends])
    return np.asarray(np.linalg.pinv(tip_jacobian(chain.lengths, angles + chain.offset)))
