"""Parts of a run between checkpoints, repeated in dual numbers for the adjoint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray, Status
from flexarm.integrate.implicit.additive_tableau import Additive
from flexarm.integrate.memory import SOFTENED, TIME, new_memory
from flexarm.integrate.transfers import additive_transfers, explicit_transfers
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.duals import DIRECTIONS, DualArray, Duals
from flexarm.simulation.derivatives.dual_run import dual_inputs, dual_system
from flexarm.simulation.derivatives.inputs import no_change
from flexarm.simulation.derivatives.parameters import Parameters

#: Steps in one call of a stepper.
_STEPS = 4096


class Block(NamedTuple):
    """Unit changes in eight directions, or fewer and zeros."""

    state: DualArray  # (2, n, 1 + m)
    torque: FloatArray  # (4, n, directions) coefficients of every piece


class Part(NamedTuple):
    """Intervals of a run between two checkpoints."""

    intervals: slice
    ends: FloatArray  # (intervals,) s
    breaks: FloatArray  # (pieces,) s, starts of the pieces of the torque
    coefficients: FloatArray  # (pieces, 4, n) of the torque
    state: FloatArray  # (2, n, 1 + m) at the start
    clock: FloatArray  # ``Memory.clock`` at the start


def blocks_of(arm: Arm, powers: int) -> list[Block]:
    """Return unit changes of the state, then of ``powers`` torque coefficients of each joint."""
    joints, count = arm.assembly.joint_body, 2 * arm.dof
    states = arm.padded(np.eye(count, count + powers * arm.joints).T.reshape(-1, 2, arm.dof))
    torques = np.zeros((len(states), 4, states.shape[2]))
    for power in range(powers):
        for joint, body in enumerate(joints):
            torques[count + power * arm.joints + joint, power, body] = 1.0
    found = []
    for k in range(0, len(states), DIRECTIONS):
        own = slice(k, k + DIRECTIONS)
        state, torque = (Duals.of(part[0] * 0.0, part[own]) for part in (states, torques))
        found.append(Block(state, torque.array[..., 1:]))
    return found


def parts_of(known: Parameters, ends: FloatArray, pieces: Sequence[int]) -> list[Part]:
    """Divide intervals, given by their ``ends`` (s) and the ``pieces`` of the torque in them."""
    run, checkpoints = known.run, known.checkpoints
    assert run.history is not None
    assert checkpoints is not None
    places = [0, *checkpoints.places]
    times = run.sample_times[places]
    edges = [*np.searchsorted(ends, times, side="right"), len(ends)]
    step = run.integrator.step or (run.progress.step if run.default_step is not None else 0.0)
    step = step or run.integrator.first_step(run.tolerance.fastest)
    first = new_memory(known.inputs.state, step).clock
    found = []
    for k, place in enumerate(places):
        if edges[k] == edges[k + 1]:
            continue
        own = slice(pieces[edges[k]], pieces[edges[k + 1] - 1] + 1)
        clock = (checkpoints.clocks[k - 1] if k and checkpoints.clocks else first).copy()
        clock[TIME], clock[SOFTENED] = times[k], np.nan
        found.append(
            Part(
                slice(edges[k], edges[k + 1]),
                ends[edges[k] : edges[k + 1]],
                run.history.breaks[own],
                known.inputs.torque[own],
                run.samples[place],
                clock,
            )
        )
    return found


class Repetition:
    """Repetition of parts of a run in dual numbers, with arrays that all parts share.

    Args:
        known: the run.
        parts: all parts that will be repeated.
        blocks: directions of the derivatives.
    """

    def __init__(self, known: Parameters, parts: Sequence[Part], blocks: Sequence[Block]) -> None:
        run = known.run
        assert run.history is not None
        self._run, self._blocks = run, blocks
        pieces = max(len(part.breaks) for part in parts)
        torque = np.zeros((pieces, *known.inputs.torque.shape[1:]))
        inputs = known.inputs._replace(torque=torque)
        numbers = dual_inputs(inputs, [no_change(inputs)])
        system = dual_system(run.system(run.history), numbers)
        self.system = system._replace(drive=system.drive._replace(breaks=np.zeros(pieces + 1)))
        self.gauges = numbers.arm.gauges
        self._torque: DualArray = numbers.torque
        self._memory = new_memory(numbers.state, 0.0)
        self._record = run.integrator.record(system.constants, numbers.state)
        most = max(len(part.ends) for part in parts)
        self._ends = np.zeros((len(blocks), most, *numbers.state.shape, 1 + DIRECTIONS))
        additive = isinstance(run.integrator, Additive)
        self._entry = Entry(additive_transfers if additive else explicit_transfers, often=1)

    def transfers(self, part: Part) -> FloatArray:
        """Return the derivatives (intervals, 2 dof, directions) of the states at the ends.

        Raises:
            SimulationError: if the run fails.
        """
        run, memory, count = self._run, self._memory, len(part.breaks)
        breaks, assembly = self.system.drive.breaks, run.arm.assembly
        breaks[:count], breaks[count:] = part.breaks, np.inf
        self._torque.value[:count] = part.coefficients
        states: DualArray = memory.state
        for block, ends in zip(self._blocks, self._ends[:, : len(part.ends)], strict=True):
            self._torque.array[..., 1:] = block.torque
            states.value[...] = part.state
            memory.clock[:] = part.clock
            status = self._entry(
                self.system, run.tolerance, self._record, memory, part.ends, block.state,
                Duals(ends), _STEPS,
            )  # fmt: skip
            if status != Status.DONE.value:
                raise run.failure(Status(status))
        whole = self._ends.reshape(*self._ends.shape[:3], -1, 1 + DIRECTIONS)
        slopes = whole[:, : len(part.ends), :, assembly.coordinates, 1:]
        columns = len(self._blocks) * DIRECTIONS
        found: FloatArray = np.moveaxis(slopes, 0, 3).reshape(len(part.ends), -1, columns)
        return found
