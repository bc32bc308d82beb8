"""Runs under a given torque: choice of the integrator, and checkpoints."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from flexarm.integrate.base import FloatArray, System
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.integrator_choice import choose_by_drive
from flexarm.simulation.run.stepping import Run, system_of
from flexarm.simulation.run.work.estimate import Start, choose_by_work


@dataclass
class Checkpoints:
    """Step control of a run at some of its samples; the states are those of the samples.

    Attributes:
        places: (k,) of the samples, ascending, without the first and the last one.
        clocks: ``Memory.clock`` at each of them; empty if the step is searched for the whole run.
    """

    places: NDArray[np.intp]
    clocks: list[FloatArray] = field(default_factory=list)

    @classmethod
    def among(cls, samples: int) -> Checkpoints:
        """Return checkpoints whose number and distances are the square root of that of samples."""
        apart = max(1, math.isqrt(samples))
        return cls(np.arange(apart, samples - 1, apart))

    def carry(self, run: Run, system: System) -> System:
        """Advance a run to the last checkpoint; return the system for the next call."""
        self.clocks.clear()
        if run.default_step is None:
            for time in run.sample_times[self.places]:
                system = run.carry_to(system, float(time))
                assert run.progress.memory is not None
                self.clocks.append(run.progress.memory.clock.copy())
        return system


def choose(run: Run, history: PiecewiseCubic) -> None:
    """Choose the integrator of a run under a given torque history, and set ``run.history``.

    Raises:
        InputError: if the run is hopeless; see ``choose_by_work``.
    """
    run.history = history
    changed = run.changes.times if run.changes is not None else np.zeros(0)
    stops = np.concatenate([run.loads.stops_with(history), changed])
    choice = choose_by_drive(run.choice, run.arm, stops, run.duration)
    start = Start(
        run.arm,
        run.progress.state,
        run.tolerance,
        run.duration,
        partial(system_of, run.arm, run.prescribed, run.loads, history),
    )
    ends = run.watch is not None and any(event.terminal for event in run.watch.log.events)
    choice = choose_by_work(choice, start, open_end=ends or run.changes is not None)
    if choice is not run.choice:
        run.adopt(choice)
        run.doubt = choice.doubt


def run_open_loop(
    run: Run, history: PiecewiseCubic, checkpoints: Checkpoints | None = None
) -> None:
    """Simulate a run under a given torque history, and fill ``checkpoints``.

    Raises:
        InputError: if the run is hopeless; see ``choose_by_work``.
        SimulationError: if the run cannot continue.
    """
    choose(run, history)
    system = run.system(history)
    if checkpoints is not None:
        system = checkpoints.carry(run, system)
    run.carry_to(system, run.duration)
