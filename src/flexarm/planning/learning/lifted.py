"""Lifted model of a trial: the outputs at all samples by the torques added in all intervals.

The closed loop of arm and controller is linearised along a simulated trial. Theory page
"control-learning", (C.100) and (C.101).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.control.analysis.linear_controller import linear_controller
from flexarm.control.contract.base import Controller, Reference, has_poles, requirements_of
from flexarm.control.contract.requirements import JOINTS
from flexarm.control.filters.predicted_readings import LINEAR_SIGNALS, reading_rows
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.small_deviations.response import held_step_maps
from flexarm.model import Instrument
from flexarm.motion.dynamics.dynamics_along import dynamics_along

if TYPE_CHECKING:
    import xarray as xr

#: Number of instants along the trial at which a controller is linearised. Most controllers are
#: linear, and the gains of the others change as slowly as the posture.
_INSTANTS = 21


class Window(NamedTuple):
    """Division of a trial into intervals in which the added torque is constant.

    Attributes:
        sample_time: of the controller, s. stride: samples per interval. intervals: their number N.
    """

    sample_time: float
    stride: int
    intervals: int

    @property
    def interval(self) -> float:
        """Length of an interval, s."""
        return self.stride * self.sample_time

    @property
    def duration(self) -> float:
        """Length of the trial, s."""
        return self.intervals * self.interval

    @property
    def ends(self) -> FloatArray:
        """Ends of the intervals (N,), s, at which the outputs are measured."""
        found: FloatArray = self.interval * np.arange(1.0, self.intervals + 1.0)
        return found


def check_linear(controller: Controller, arm: Arm, reference: Reference) -> tuple[str, ...]:
    """Return the readings of a controller that can be linearised along a trial.

    Raises:
        InputError: if it has no ``step``, or requires other readings.
    """
    if not has_poles(controller):
        hint = "It is needed to predict the next trial; see flexarm.Controller."
        raise InputError(Problem("controller", "have a step", shown(controller), hint))
    names = requirements_of(controller, arm, reference).measured or JOINTS
    if others := [name for name in names if name not in LINEAR_SIGNALS]:
        rule = "require no readings except " + ", ".join(LINEAR_SIGNALS)
        raise InputError(Problem("controller", rule, ", ".join(others)))
    return tuple(names)


def lifted_model(
    arm: Arm, controller: Controller, reference: Reference, trial: xr.Dataset, window: Window
) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of tip and joint angles at the ends of the intervals.

    Args:
        arm: the model. controller, reference: those of the trial.
        trial: result of ``simulate`` at the sample times of the controller.
        window: the intervals.

    Returns:
        Tip position (N, 2, N, joints) m and joint angles (N, joints, N, joints) rad, by the torque
        added in each interval, N m.
    """
    names = check_linear(controller, arm, reference)
    count, steps = window.intervals, window.intervals * window.stride
    q, qd = trial["q"].values[: steps + 1], trial["qd"].values[: steps + 1]
    read = np.concatenate([reading_rows(arm, Instrument(signal=name)) for name in names])
    laws = _laws(controller, reference, trial, names, window.sample_time, steps)
    ends = slice(window.stride, None, window.stride)
    tip_rows = dynamics_along(arm, q[ends], qd[ends], np.zeros_like(q[ends])).tip_by[:, :2, 0]
    n, m = 2 * arm.dof, arm.joints
    X = np.zeros((n + laws[0].shape[1], count * m))
    tip, angle = np.zeros((count, 2, count * m)), np.zeros((count, m, count * m))
    for first, A, B in held_step_maps(arm, window.sample_time, q, qd):
        for k, (by_state, by_torque) in enumerate(zip(A, B, strict=True), start=first):
            i = k // window.stride
            known = X[:, : (i + 1) * m]
            Ac, Bc, Cc, Dc = (law[k] for law in laws)
            torque = Dc @ read @ known[:n] + Cc @ known[n:]
            torque[:, i * m :] += np.eye(m)
            known[n:] = Bc @ read @ known[:n] + Ac @ known[n:]
            known[:n] = by_state @ known[:n] + by_torque @ torque
            if (k + 1) % window.stride == 0:
                tip[i] = tip_rows[i] @ X[: arm.dof]
                angle[i] = X[arm.joint_index]
    return tip.reshape(count, 2, count, m), angle.reshape(count, m, count, m)


def _laws(
    controller: Controller,
    reference: Reference,
    trial: xr.Dataset,
    names: tuple[str, ...],
    sample_time: float,
    steps: int,
) -> list[FloatArray]:
    """Return the matrices of the linearised controller at each sample, (steps, ...) each."""
    at = np.unique(np.linspace(0, steps - 1, _INSTANTS).round().astype(int))
    found = []
    for k in at.tolist():
        measured = {name: trial[name].values[k] for name in names}
        found.append(linear_controller(controller, measured, reference, k * sample_time))
    samples = np.arange(steps)
    left = np.clip(np.searchsorted(at, samples, side="right") - 1, 0, max(at.size - 2, 0))
    right = np.minimum(left + 1, at.size - 1)
    weight = (samples - at[left]) / np.maximum(at[right] - at[left], 1)
    laws = []
    for part in zip(*found, strict=True):
        matrices = np.array(part)
        w = weight[:, None, None]
        laws.append((1.0 - w) * matrices[left] + w * matrices[right])
    return laws
