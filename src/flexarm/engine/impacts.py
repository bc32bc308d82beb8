"""Runs under a given torque: checkpoints, and tighter tolerances if joints meet their stops.

Each impact multiplies the errors made before it, by 5 to 20 with flexible links: an error of 1e-9
of the reach at the first impact is 1e-4 at the sixth, even if the impacts are located exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from flexarm.engine.integrator_choice import choose_by_drive
from flexarm.engine.stepping import Run
from flexarm.engine.tolerance import RTOL, TIGHT
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray, Progress, System

#: Difference of both runs, as a fraction of the reach, above which the second run gets a warning.
#: In trials the error of the second run was 1e-5 of the difference if that was small, and at most
#: 1 % of it at this limit.
_PARTED = 1e-2


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


def run_open_loop(
    run: Run, history: PiecewiseCubic, checkpoints: Checkpoints | None = None
) -> None:
    """Simulate a run under a given torque history, and fill ``checkpoints``."""
    run.history = history
    changed = run.changes.times if run.changes is not None else np.zeros(0)
    stops = np.concatenate([run.loads.stops_with(history), changed])
    choice = choose_by_drive(run.choice, run.arm, run.tolerance, stops, run.duration)
    if choice is not run.choice:
        run.choice, run.integrator, run.doubt = choice, choice.integrator, choice.doubt
        if run.watch is not None:
            run.watch = replace(run.watch, integrator=choice.integrator)
    system = run.system(history)
    if checkpoints is not None:
        system = checkpoints.carry(run, system)
    run.carry_to(system, run.duration)


def run_through_impacts(
    run: Run,
    history_of: Callable[[float], PiecewiseCubic],
    checkpoints: Checkpoints | None = None,
) -> None:
    """Simulate under a torque; at default tolerances, repeat the run if joints meet their stops.

    Args:
        history_of: function that returns the torque history for a relative tolerance of the run.
        checkpoints: filled by the simulation that counts.

    Raises:
        SimulationError: if the run cannot continue; ``run`` keeps the samples computed last.
    """
    tolerance, first = run.tolerance, run.progress
    times, duration = run.sample_times, run.duration
    mark = run.watch.mark() if run.watch is not None else None
    history = history_of(tolerance.relative)  # also sets the start of prescribed joints
    start = first.state.copy()
    run_open_loop(run, history, checkpoints)
    if first.impacts == 0 or tolerance.relative != RTOL:
        return
    before, before_times = run.samples, run.sample_times
    run.begin_again()
    run.tolerance = tolerance._replace(relative=TIGHT * RTOL, absolute=TIGHT * tolerance.absolute)
    run.sample_times, run.duration = times, duration
    run.samples = np.empty((len(times), *start.shape))
    run.progress = Progress(0.0, start, 0.0)
    if run.watch is not None and mark is not None:
        run.watch = replace(run.watch, tolerance=run.tolerance)
        run.watch.restore(mark)
    if run.loads_of is not None:  # make the loads of the second run as accurate as its torque
        run.loads = run.loads_of(run.tolerance.relative)
    run_open_loop(run, history_of(run.tolerance.relative), checkpoints)
    run.discarded = first.evaluations
    apart = _apart(run, before, before_times, first.sample)
    reach = 1.0 / float(tolerance.unit[0, :, 0].min())
    parted = np.flatnonzero(~(apart <= _PARTED * reach))
    if parted.size:
        run.doubt = (
            f"impacts on joint stops amplify errors: the motions at rtol={RTOL:g} and at "
            f"rtol={TIGHT * RTOL:g} differ by {apart.max() * tolerance.scale:.2g} m at the tip, "
            f"and by 1 % of the reach from t = {run.sample_times[parted[0]]:.4g} s on. Do not rely "
            "on this result after that time."
        )


def _apart(run: Run, before: FloatArray, before_times: FloatArray, count: int) -> FloatArray:
    """Return the tip difference, over ``Tolerance.scale``, from the earlier samples.

    It is zero where the times differ.
    """
    count = min(count, run.progress.sample)
    same = before_times[:count] == run.sample_times[:count]  # an event may be the last sample
    apart = np.abs(before[:count, 0] - run.samples[:count, 0]) / run.tolerance.unit[0]
    largest: FloatArray = apart.max(axis=(1, 2)) * same
    return largest
