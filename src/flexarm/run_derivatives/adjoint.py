"""Gradient of a scalar goal by torque samples and initial state: the adjoint of the steps.

The run is divided at the torque samples. Dual numbers give the derivatives of the state at each end
by the state and the torque of the interval, whose number does not depend on that of the samples. A
recursion backwards in time then collects the gradient; theory page "separation", (D.17).
"""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from flexarm.errors import InputError, Problem, shown
from flexarm.integrate.base import FloatArray, Status
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive
from flexarm.integrate.memory import new_memory
from flexarm.integrate.transfers import additive_transfers, explicit_transfers
from flexarm.kernels.compilation.dual_arrays import DualArray, Duals
from flexarm.kernels.compilation.duals import DIRECTIONS
from flexarm.processes import usable_cores
from flexarm.run_derivatives.channels import channel_derivatives
from flexarm.run_derivatives.dual_run import DualRun, dual_inputs, dual_system
from flexarm.run_derivatives.inputs import Inputs, no_change
from flexarm.run_derivatives.parameters import Parameters, Samples

#: Powers of time in the torque between two samples.
_POWERS = {"hold": 1, "linear": 2, "cubic": 4}
#: Steps in one call of a stepper.
_STEPS = 4096


class Gradient(NamedTuple):
    """Gradient of a goal."""

    torque: FloatArray  # (samples, joints)
    state: FloatArray  # (2, dof) by q and qd at the start


class _Block(NamedTuple):
    """Derivatives in some directions."""

    transfers: FloatArray  # (directions, intervals, 2 dof) of the states at the ends
    goal: FloatArray  # (directions, samples) of the goal by the states at the samples


def goal_gradient_of(
    known: Parameters, samples: Samples, weights: Mapping[str, FloatArray]
) -> Gradient:
    """Return the gradient of the sum of ``weights`` times channels over all samples of a run.

    Raises:
        InputError: if the integrator is not a one-step method without iteration.
        SimulationError: if the run fails.
    """
    run, arm = known.run, known.run.arm
    if not isinstance(run.integrator, ExplicitRungeKutta | Additive):
        rule = "be an explicit Runge-Kutta method or kennedy_carpenter_5 for a gradient"
        raise InputError(Problem("integrator", rule, shown(run.integrator.name)))
    assert run.history is not None
    breaks = run.history.breaks
    ends = np.unique(np.concatenate([breaks, run.sample_times[1:], [run.duration]]))
    ends = ends[(ends > 0.0) & (ends <= run.duration)]
    by = _directions(known, _POWERS[samples.interpolation])
    blocks = [by[k : k + DIRECTIONS] for k in range(0, len(by), DIRECTIONS)]
    with ThreadPoolExecutor(min(len(blocks), usable_cores())) as pool:
        found = list(pool.map(lambda block: _block(known, ends, block, weights), blocks))
    transfers = np.concatenate([block.transfers for block in found])
    goal = np.concatenate([block.goal for block in found])[: 2 * arm.dof]
    at_ends = np.zeros((len(ends), 2 * arm.dof))
    at_ends[np.searchsorted(ends, run.sample_times[1:])] = goal[:, 1:].T
    state, torque = _backwards(transfers, at_ends)
    state += goal[:, 0]
    pieces = np.zeros((len(breaks) - 1, torque.shape[1]))
    middle = 0.5 * (np.append(0.0, ends[:-1]) + ends)
    piece = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, len(pieces) - 1)
    np.add.at(pieces, piece, torque)
    by_samples = samples.collected(pieces.reshape(len(pieces), -1, arm.joints))
    return Gradient(by_samples, state.reshape(2, -1))


def _directions(known: Parameters, powers: int) -> list[Inputs]:
    """Return unit changes of the state, then of the torque coefficients of every piece."""
    arm, nothing = known.run.arm, no_change(known.inputs)
    states = np.eye(2 * arm.dof).reshape(-1, 2, arm.dof)
    found = [nothing._replace(state=arm.padded(unit)) for unit in states]
    for power in range(powers):
        for joint in arm.assembly.joint_body:
            torque = np.zeros(known.inputs.torque.shape)
            torque[:, power, joint] = 1.0
            found.append(nothing._replace(torque=torque))
    return found


def _block(
    known: Parameters, ends: FloatArray, by: list[Inputs], weights: Mapping[str, FloatArray]
) -> _Block:
    run, arm = known.run, known.run.arm
    assert run.history is not None
    numbers = dual_inputs(known.inputs, by)
    system = dual_system(run.system(run.history), numbers)
    seeds: DualArray = numbers.state.copy()
    seeds.array[..., 0] = 0.0
    step = run.integrator.step or (run.progress.step if run.default_step is not None else 0.0)
    memory = new_memory(numbers.state, step or run.integrator.first_step(run.tolerance.fastest))
    record = run.integrator.record(system.constants, numbers.state)
    transfers: DualArray = Duals.zeros(len(ends), *numbers.state.shape)
    additive = isinstance(run.integrator, Additive)
    kernel: Any = additive_transfers if additive else explicit_transfers
    status = kernel(system, run.tolerance, record, memory, ends, seeds, transfers, _STEPS)
    if status != Status.DONE.value:
        raise run.failure(Status(status))
    states = Duals.zeros(len(run.sample_times), *numbers.state.shape)
    states.array[0, ..., 0] = known.inputs.state
    states.array[1:, ..., 0] = transfers.value[np.searchsorted(ends, run.sample_times[1:])]
    states.array[..., 1:] = seeds.array[..., 1:]
    observed = DualRun(states, system.constants, numbers.arm.gauges, 0)
    channels = channel_derivatives(arm, observed, len(by), list(weights))
    slopes = arm.unpadded(transfers.slopes[: len(by)])
    return _Block(
        slopes.reshape(*slopes.shape[:2], -1),
        np.array(
            [
                sum((w * one[name]).reshape(len(w), -1).sum(axis=1) for name, w in weights.items())
                for one in channels
            ]
        ),
    )


def _backwards(transfers: FloatArray, at_ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradient by the state at the start, and by the coefficients of each interval.

    Args:
        transfers: (states + coefficients, intervals, states). at_ends: (intervals, states).
    """
    count = at_ends.shape[1]
    adjoint = np.zeros(count)
    torque = np.zeros((len(at_ends), len(transfers) - count))
    for k in reversed(range(len(at_ends))):
        both = transfers[:, k] @ (adjoint + at_ends[k])
        adjoint, torque[k] = both[:count], both[count:]
    return adjoint, torque
