"""Recorded run of an arm: arguments of the exported functions and the results of Python."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmWarning
from flexarm.bridges.c_code.exported import Exported
from flexarm.bridges.c_code.observer import Observer
from flexarm.bridges.c_code.observer_recording import estimates, record_observer
from flexarm.bridges.c_code.pressed_run import contact_readings
from flexarm.bridges.c_code.replay import replay
from flexarm.linear.step_derivatives.step_jacobian import step_jacobian
from flexarm.simulation.calls.run import simulate

#: Number of recorded samples, and number of steps of the run between two of them.
SAMPLES, _STRIDE = 32, 8
#: Steps are this fraction of the largest one, and at most this long (s).
_FRACTION, _LONGEST = 0.2, 1e-3
#: Relative deviation that rounding explains; on an ill-conditioned arm, also this multiple of
#: the condition number times the relative precision.
_ROUNDING, _CONDITION = 1e-12, 2.0
#: Rounding errors within a controller, in multiples of those of its readings.
_AMPLIFIED = 8.0
#: Number of runs of a filter with rounded inputs; single ones differ by a factor of four.
_ROUNDED_RUNS = 4


@dataclass(frozen=True, eq=False)
class Recording:
    """Recorded run.

    Attributes:
        step: s, of the run.
        inputs: (samples, size) by the name of the argument.
        expected: (samples, size) by the name of the function, all its results in one row.
        tolerance: (size,) by the name of the function.
    """

    step: float
    inputs: dict[str, FloatArray]
    expected: dict[str, FloatArray]
    tolerance: dict[str, FloatArray]


def record(export: Exported) -> Recording:
    """Simulate an arm under smooth torques, and evaluate its methods along the run."""
    arm = _smoothed(export.arm)
    step = min(_LONGEST, _FRACTION * export.largest_step)
    count = SAMPLES * _STRIDE
    torque = _torques(arm, count)
    with warnings.catch_warnings():
        # The run only compares two programs: it may leave the validity of the theory.
        warnings.simplefilter("ignore", FlexarmWarning)
        run = simulate(
            arm,
            count * step,
            torque=torque,
            rate=1.0 / step,
            torque_interpolation="hold",
            integrator="rk4",
            step=step,
        )
    at = np.arange(SAMPLES) * _STRIDE
    q, qd = run.q.values, run.qd.values
    push = 0.1 * np.sin(np.arange(SAMPLES)[:, None] + np.arange(3.0))
    found = Recording(
        step, {"q": q[at], "qd": qd[at], "torque": torque[at], "tip_force": push}, {}, {}
    )
    _record_arm(found, export, np.hstack([q[at + 1], qd[at + 1]]))
    if export.controller:
        readings = {
            "joint_angle": run.joint_angle.values[at],
            "joint_rate": run.joint_rate.values[at],
            "strain": run.strain.values[at] if arm.gauges else np.zeros((SAMPLES, 0)),
            "tip": np.array([arm.tip(one)[:2] for one in q[at]]),
            "contact_force": contact_readings(export.controller.controller, SAMPLES),
        }
        _record_controller(found, export, readings)
    if export.observer:
        _record_observer(found, export.observer)
    return found


def _smoothed(arm: Arm) -> Arm:
    """Return an arm whose friction is a function of the rate, as in the exported functions."""
    joints = []
    for joint in arm.spec.joints:
        if joint.friction is not None:
            rate = joint.friction.model_rate
            plain = {"bristle_stiffness": None, "bristle_damping": 0.0, "smoothing_rate": rate}
            joint = joint.replace(friction=joint.friction.replace(**plain))
        joints.append(joint)
    return Arm(arm.spec.replace(joints=joints))


def _torques(arm: Arm, count: int) -> FloatArray:
    """Return torques (count, joints) that accelerate the joints by some rad/s^2."""
    M = arm.mass_matrix(np.zeros(arm.dof))[arm.joint_index, arm.joint_index]
    phase = np.linspace(0.0, 2.0 * np.pi, count)[:, None] * np.arange(1, arm.joints + 1)
    torque: FloatArray = 3.0 * M * np.sin(phase)
    return torque


def _record_arm(found: Recording, export: Exported, after: FloatArray) -> None:
    arm, given = export.arm, found.inputs
    q, qd, torque, push = (given[name] for name in ("q", "qd", "torque", "tip_force"))
    qdd = np.array([arm.forward_dynamics(*one) for one in zip(q, qd, torque, push, strict=True)])
    # Half of the accelerations, because all of them would cancel the other forces.
    given["qdd"] = 0.5 * qdd
    results: dict[str, Callable[[int], Any]] = {
        "forward_dynamics": lambda k: qdd[k],
        "inverse_dynamics": lambda k: arm.inverse_dynamics(q[k], qd[k], given["qdd"][k], push[k]),
        "bias_force": lambda k: arm.bias_force(q[k], qd[k]),
        "mass_matrix": lambda k: arm.mass_matrix(q[k]),
        "energy": lambda k: arm.energy(q[k], qd[k])[:3],
        "tip": lambda k: arm.tip(q[k]),
        "tip_velocity": lambda k: arm.tip_velocity(q[k], qd[k]),
        "strain": lambda k: arm.strain(q[k]),
        "tip_jacobian": lambda k: np.transpose(
            [arm.tip_velocity(q[k], e) for e in np.eye(arm.dof)]
        ),
        "step": lambda k: after[k],
    }
    for function in export.functions:
        if function.name in results:
            rows = [np.ravel(results[function.name](k)) for k in range(SAMPLES)]
            found.expected[function.name] = np.array(rows)
            found.tolerance[function.name] = _ROUNDING * _largest(rows)
    slopes = [step_jacobian(arm, q[k], qd[k], torque[k], found.step) for k in range(SAMPLES)]
    rows = [np.concatenate([one.state.ravel(), one.torque.ravel()]) for one in slopes]
    found.expected["step_jacobian"] = np.array(rows)
    _scale_by_energy(found, arm)


def _largest(rows: Any) -> FloatArray:
    """Return the largest number of all rows, for each entry of a row."""
    values = np.abs(np.array(rows))
    return np.full(values.shape[1], values.max(initial=0.0))


def _scale_by_energy(found: Recording, arm: Arm) -> None:
    """Set the tolerances of coordinates as if they were energies.

    Metres and radians then count alike, and so do errors of an ill-conditioned mass matrix.
    """
    M = arm.mass_matrix(found.inputs["q"][0])
    scale = np.sqrt(np.diag(M))
    condition = np.linalg.cond(M / np.outer(scale, scale))
    limit = max(_ROUNDING, _CONDITION * np.finfo(float).eps * condition)
    n, m = arm.dof, arm.joints
    both = np.concatenate([scale, scale])
    found.tolerance["forward_dynamics"] = (
        limit * np.abs(scale * found.expected["forward_dynamics"]).max() / scale
    )
    after = np.abs(both * found.expected["step"])
    parts = [np.full(n, after[:, :n].max()), np.full(n, after[:, n:].max())]
    found.tolerance["step"] = limit * np.concatenate(parts) / both
    slopes = np.abs(found.expected["step_jacobian"])
    weight = np.concatenate([np.outer(both, 1.0 / both).ravel(), np.repeat(both, m)])
    block = np.concatenate(
        [
            (2 * np.repeat([0, 1], n)[:, None] + np.repeat([0, 1], n)).ravel(),
            np.repeat([4, 5], n * m),
        ]
    )
    largest = [np.max((weight * slopes)[:, block == k], initial=0.0) for k in range(6)]
    found.tolerance["step_jacobian"] = limit * np.array(largest)[block] / weight


def _record_controller(found: Recording, export: Exported, readings: dict[str, FloatArray]) -> None:
    """Record the torques of the controller for the readings of the run."""
    assert export.controller is not None
    inputs, torque = replay(export.arm, export.controller, readings)
    found.inputs.update(inputs)
    found.expected["controller"] = torque
    # Large gains of a filter amplify the rounding of its readings. Measure how much.
    change = np.abs(replay(export.arm, export.controller, _rounded(readings, 0))[1] - torque)
    limit = max(_ROUNDING * np.abs(torque).max(), _AMPLIFIED * change.max())
    found.tolerance["controller"] = np.full(torque.shape[1], limit)


def _record_observer(found: Recording, observer: Observer) -> None:
    """Record the estimates of the filter for a run of its own, at its sample time."""
    inputs, expected = record_observer(observer, SAMPLES)
    found.inputs.update(inputs)
    found.expected["observer"] = expected
    rounded = [_rounded(inputs, seed) for seed in range(_ROUNDED_RUNS)]
    changes = [np.abs(estimates(observer.filter, one) - expected) for one in rounded]
    change, largest = np.max(changes, axis=(0, 1)), np.abs(expected).max(axis=0)
    found.tolerance["observer"] = np.maximum(_ROUNDING * largest, _AMPLIFIED * change)


def _rounded(values: dict[str, FloatArray], seed: int) -> dict[str, FloatArray]:
    """Return numbers with a random rounding error each."""
    signs = np.random.default_rng(seed)
    return {
        name: one * (1.0 + np.finfo(float).eps * signs.choice([-1.0, 1.0], one.shape))
        for name, one in values.items()
    }
