"""Gradient of a scalar goal by torque samples and initial state: the adjoint of the steps.

The run is divided at the torque samples. Dual numbers give the derivatives of the state at each end
by the state and the torque of the interval, whose number does not depend on that of the samples. A
recursion backwards in time then collects the gradient; theory page "separation", (D.17).

The recursion repeats the run from checkpoint to checkpoint, the last part first, so that the
derivatives of a few parts are in memory at a time. Both the number of parts and the length of each
grow with the square root of the number of samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np

from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.processes import usable_cores
from flexarm.integrate.base import FloatArray
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive
from flexarm.kernels.compilation.duals import DIRECTIONS, Duals
from flexarm.simulation.derivatives.channels import channel_derivatives
from flexarm.simulation.derivatives.dual_run import DualRun
from flexarm.simulation.derivatives.parameters import Parameters, Samples
from flexarm.simulation.derivatives.repeated_parts import (
    Block,
    Part,
    Repetition,
    blocks_of,
    parts_of,
)

#: Powers of time in the torque between two samples.
_POWERS = {"hold": 1, "linear": 2, "cubic": 4}
#: Samples whose channels are differentiated together, which bounds the memory of long runs.
_CHUNK = 1024


class Gradient(NamedTuple):
    """Gradient of a goal."""

    torque: FloatArray  # (samples, joints)
    state: FloatArray  # (2, dof) by q and qd at the start


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
    middle = 0.5 * (np.append(0.0, ends[:-1]) + ends)
    piece = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, len(breaks) - 2)
    parts = parts_of(known, ends, piece)
    powers = _POWERS[samples.interpolation]
    blocks = blocks_of(arm, powers)
    threads = min(usable_cores(), len(parts))
    repetitions = [Repetition(known, parts, blocks) for _ in range(threads)]
    torque = np.zeros((len(ends), powers * arm.joints))
    with ThreadPoolExecutor(threads) as pool:
        goal = _by_samples(known, weights, blocks, repetitions[0], pool)
        at_ends = np.zeros((len(ends), goal.shape[1]))
        at_ends[np.searchsorted(ends, run.sample_times[1:])] = goal[1:]
        state = goal[0] + _backwards(parts, at_ends, torque, repetitions, pool)
    pieces = np.zeros((len(breaks) - 1, torque.shape[1]))
    np.add.at(pieces, piece, torque)
    by_samples = samples.collected(pieces.reshape(len(pieces), -1, arm.joints))
    return Gradient(by_samples, state.reshape(2, -1))


def _by_samples(
    known: Parameters,
    weights: Mapping[str, FloatArray],
    blocks: Sequence[Block],
    repetition: Repetition,
    pool: Executor,
) -> FloatArray:
    """Return the gradient (samples, 2 dof) of the goal by the states at the samples."""
    states, count = known.run.samples, 2 * known.run.arm.dof
    sizes = [min(DIRECTIONS, count - first) for first in range(0, count, DIRECTIONS)]
    found = []
    for first in range(0, len(states), _CHUNK):
        own = slice(first, first + _CHUNK)
        part = {name: array[own] for name, array in weights.items()}
        of_block = partial(_of_block, known, part, states[own], repetition)
        found.append(np.concatenate(list(pool.map(of_block, blocks, sizes))).T)
    return np.concatenate(found)


def _of_block(
    known: Parameters,
    weights: Mapping[str, FloatArray],
    states: FloatArray,
    repetition: Repetition,
    block: Block,
    count: int,
) -> FloatArray:
    """Return the derivatives (count, samples) of the goal by ``states`` in some directions."""
    duals = Duals.of(states)
    duals.array[..., 1:] = block.state.array[..., 1:]
    run = DualRun(duals, repetition.system.constants, repetition.gauges, 0)
    return np.array(
        [
            sum((w * one[name]).reshape(len(w), -1).sum(axis=1) for name, w in weights.items())
            for one in channel_derivatives(known.run.arm, run, count, list(weights))
        ]
    )


def _backwards(
    parts: Sequence[Part],
    at_ends: FloatArray,
    torque: FloatArray,
    repetitions: Sequence[Repetition],
    pool: Executor,
) -> FloatArray:
    """Return the gradient by the state at the start, and fill that by the torque.

    Args:
        at_ends: (intervals, states) gradient by the states at the ends of the intervals.
        torque: (intervals, k) gradient by the coefficients of the torque in each interval.
    """
    count, width = at_ends.shape[1], torque.shape[1]
    adjoint = np.zeros(count)
    for part, transfers in _from_the_last(parts, repetitions, pool):
        goal, own = at_ends[part.intervals], torque[part.intervals]
        for k in reversed(range(len(transfers))):
            both = (adjoint + goal[k]) @ transfers[k]
            adjoint, own[k] = both[:count], both[count : count + width]
    return adjoint


def _from_the_last(
    parts: Sequence[Part], repetitions: Sequence[Repetition], pool: Executor
) -> Iterator[tuple[Part, FloatArray]]:
    """Yield each part and its transfers, while those of the parts before it are computed."""
    together = len(repetitions)
    found: list[tuple[Part, FloatArray]] = []
    for last in range(len(parts), 0, -together):
        group = parts[max(0, last - together) : last][::-1]
        ahead = pool.map(Repetition.transfers, repetitions, group)
        yield from found
        found = list(zip(group, ahead, strict=True))
    yield from found
