"""Simulation by the paper's separation: rigid motion and linear deviations from it."""

from __future__ import annotations

import time
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import too_far_deviated
from flexarm.arm.observe import channels_of
from flexarm.base.arguments import check_choice, check_function
from flexarm.base.errors import (
    InputError,
    LargeDeflectionWarning,
    Problem,
    SimulationError,
    check_array,
    public_call,
    warn_caller,
)
from flexarm.base.late import interpolate, xr
from flexarm.linear import modes
from flexarm.linear.small_deviations.along import (
    DeviationPath,
    Separation,
    SmoothMatrices,
    break_times,
    linearize_along,
    solve_deviations,
    stage_times,
    step_edges,
)
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.quantities import Positive
from flexarm.model.scenarios.scenario import recording_rate, sample_fault
from flexarm.motion import Motion, rigid_torque
from flexarm.motion.motion import check_motion
from flexarm.simulation.calls.result import make_result
from flexarm.simulation.histories.piecewise import PiecewiseCubic, function_history
from flexarm.simulation.run.tolerance import RTOL as CLOSE

METHODS = ("dynamic", "quasi_static")
#: Two runs, one with half the step, must agree to this fraction of the largest deviation. The
#: linearization error exceeds it if deflections are significant.
RTOL = 1e-3
#: Maximum number of times that the steps are halved.
_HALVINGS = 12


@public_call
def simulate_separated(
    arm: Arm,
    motion: Motion,
    duration: Positive | None = None,
    *,
    method: str = "dynamic",
    joints: str = "free",
    added_torque: Callable[[float], ArrayLike] | None = None,
    initial_deviation: ArrayLike | None = None,
    initial_deviation_rate: ArrayLike | None = None,
    breaks: ArrayLike = (),
    rate: Positive | None = None,
    rtol: Positive = RTOL,
) -> xr.Dataset:
    """Simulate an arm under the rigid torques of a motion, by the paper's separation.

    Args:
        arm: the flexible arm.
        motion: the rigid reference.
        duration: s from time zero; by default to the end of the motion.
        method: "dynamic": linear time-varying deviations. "quasi_static": links bent by the
            forces of inertia and gravity at each instant, joints on the motion.
        joints: "free", or "locked" to the motion.
        added_torque: function of time: (joints,) N m in addition to the rigid torque.
        initial_deviation, initial_deviation_rate: (dof,) from the reference at time zero; zero by
            default.
        breaks: times (s) at which ``added_torque`` jumps or has a kink, as in ``simulate``.
        rate: samples recorded per second, Hz; by default as for `simulate`.
        rtol: steps are halved until two runs agree to this fraction of the largest deviation.

    Returns:
        Dataset as returned by ``simulate``, without the joint reactions. ``torque`` is the motor
        torque; with locked joints, that of the deflected arm to first order.

    Raises:
        InputError: if an argument has the wrong shape or value.
        SimulationError: if the deviations do not converge to ``rtol``.

    Warns:
        LargeDeflectionWarning: if a link exceeds the linear beam theory.

    Theory page "separation", (D.5) to (D.7).
    """
    started = time.perf_counter()
    refuse_bristles(arm, "the separation", hint="fa.simulate supports them.")
    serial_only(arm.spec, "the separation", UNDRIVEN)
    motion = check_motion(motion, arm)
    method = check_choice("method", method, METHODS)
    model = linearize_along(arm, motion, joints=joints, times=np.zeros(1))
    until = motion.end_time if duration is None else duration
    rate = recording_rate(rate, until)
    fault = sample_fault(until, rate)
    if fault is not None:
        raise InputError(fault.problem())
    count = int(np.floor(until * rate * (1 + 1e-12))) + 1
    times = np.minimum(np.arange(count) / rate, until)
    start = [
        _start("initial_deviation", initial_deviation, arm)[model.kept],
        _start("initial_deviation_rate", initial_deviation_rate, arm)[model.kept],
    ]
    attributes: dict[str, Any] = {"method": method, "joints": joints, "rtol": rtol}
    added = None
    if added_torque is not None:
        check_function("added_torque", added_torque)
        # The result contains the torque, so its tolerance is at most the default of ``simulate``.
        relative, name = min(rtol, CLOSE), "added_torque"
        accuracy = relative, breaks, name, 1.0 / rate
        added = function_history(added_torque, until, arm.n_joints, *accuracy)
        attributes["shortest_feature"] = added.shortest_feature
    if method == "quasi_static":
        given = {
            "added_torque": added_torque,
            "initial_deviation": initial_deviation,
            "initial_deviation_rate": initial_deviation_rate,
        }
        for name in (name for name, value in given.items() if value is not None):
            rule = (
                "is not supported by the quasi_static estimate, which depends on the reference only"
            )
            raise InputError(Problem(name, rule))
        dq, dqd = _quasi_static(model, times, until)
    else:
        path = _converged(model, until, start, added, rtol)
        dq, dqd = path.at(times)
        attributes |= {"steps": len(path.edges) - 1, "step": float(np.max(np.diff(path.edges)))}
    attributes |= {
        "integrator": "gauss6" if method == "dynamic" else "quasi_static",
        "references": "HairerWanner1996" if method == "dynamic" else "",
    }
    torque = rigid_torque(arm, motion)(times)
    if added is not None and joints == "free":
        torque += added.at(times)
    if joints == "locked":
        torque += _taken(model.at(times), dq, dqd)
    q, qd = np.zeros((2, times.size, arm.dof))
    q[:, arm.joint_index], qd[:, arm.joint_index], _ = motion.state(times)
    q[:, model.kept] += dq
    qd[:, model.kept] += dqd
    attributes["wall_seconds"] = time.perf_counter() - started
    states = arm.padded(np.stack([q, qd], axis=1))
    attributes["warning"] = too_far_deviated(arm, states)
    channels = channels_of(arm, states) | {"torque": torque}
    result = make_result(arm, times, channels, attributes)
    if result.attrs["warning"]:
        warn_caller(result.attrs["warning"], LargeDeflectionWarning)
    return result


def _converged(
    model: Separation,
    until: float,
    start: list[FloatArray],
    added: PiecewiseCubic | None,
    rtol: float,
) -> DeviationPath:
    """Halve the steps until two runs agree to ``rtol`` of the largest deviation."""
    frequency = modes(model.arm, model.motion.joint_angle(0.0)).frequency_hz
    longest = until / 16.0
    if frequency.size and frequency[0] > 0.0:
        longest = min(longest, 0.5 / float(frequency[0]))
    matrices = SmoothMatrices(model)
    kinks = break_times(model.motion, until)
    if added is not None:
        kinks = np.union1d(kinks, added.stops)

    def run(longest: float) -> DeviationPath:
        edges = step_edges(kinks, longest)
        force = None
        if added is not None and model.joints == "free":
            times = stage_times(edges)
            force = np.zeros((*times.shape, model.kept.size))
            torque = added.at(times.ravel()).reshape(*times.shape, -1)
            force[..., model.arm.joint_index] = torque
        return solve_deviations(matrices, edges, start[0], start[1], force)

    coarse = run(longest)
    for _ in range(_HALVINGS):
        longest *= 0.5
        fine = run(longest)
        # Compare in the middle of the coarser steps, where the interpolation has larger errors.
        times = 0.5 * (coarse.edges[:-1] + coarse.edges[1:])
        (dq, _), (other, _) = fine.at(times), coarse.at(times)
        if np.max(np.abs(dq - other)) <= rtol * np.max(np.abs(dq)):
            return fine
        coarse = fine
    reason = f"the deviations have not converged to rtol with steps of {longest:.2g} s."
    raise SimulationError(0.0, reason, "Increase rtol, or add damping to the stiffest modes.")


def _quasi_static(
    model: Separation, times: FloatArray, until: float
) -> tuple[FloatArray, FloatArray]:
    """Return the quasi-static deflection, and its rate from splines between the breaks."""
    _, _, K, r = SmoothMatrices(model).at(times)
    dq = model.bent(K, r)
    dqd = np.zeros_like(dq)
    breaks = break_times(model.motion, until)
    for a, b in pairwise(breaks):
        own = (times >= a) & ((times < b) | (b == until))
        if np.count_nonzero(own) >= 4:  # a not-a-knot spline needs four samples
            dqd[own] = interpolate.CubicSpline(times[own], dq[own])(times[own], 1)
    return dq, dqd


def _taken(sampled: Separation, dq: FloatArray, dqd: FloatArray) -> FloatArray:
    """Return the added torque (T, joints) of locked joints to first order; (D.8)."""
    arm, kept = sampled.arm, sampled.kept
    free = linearize_along(arm, sampled.motion, times=sampled.time).deviation
    own = sampled.deviation
    left = own.r - np.einsum("tij,tj->ti", own.K, dq) - np.einsum("tij,tj->ti", own.D, dqd)
    ddq = np.linalg.solve(own.M, left[:, :, None])[:, :, 0]
    rows = arm.joint_index[:, None], kept
    return np.asarray(
        np.einsum("tij,tj->ti", free.K[:, *rows], dq)
        + np.einsum("tij,tj->ti", free.D[:, *rows], dqd)
        + np.einsum("tij,tj->ti", free.M[:, *rows], ddq)
    )


def _start(name: str, value: ArrayLike | None, arm: Arm) -> FloatArray:
    return np.zeros(arm.dof) if value is None else check_array(name, value, (arm.dof,))
