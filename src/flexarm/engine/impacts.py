"""Repeated simulation, with tighter tolerances, of runs in which joints meet their stops.

Each impact multiplies the errors made before it, by 5 to 20 with flexible links: an error of 1e-9
of the reach at the first impact is 1e-4 at the sixth, even if the impacts are located exactly.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexarm.engine.stepping import Run, run_open_loop
from flexarm.engine.tolerance import TIGHT
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray, Progress

#: Default tolerances: tip errors are near 1e-6 of the reach over the durations of the examples.
RTOL, ATOL = 1e-7, 1e-9
#: Difference of both runs, as a fraction of the reach, above which the second run gets a warning.
#: In trials the error of the second run was 1e-5 of the difference if that was small, and at most
#: 1 % of it at this limit.
_PARTED = 1e-2


def run_through_impacts(run: Run, history_of: Callable[[float], PiecewiseCubic]) -> None:
    """Simulate under a torque; at default tolerances, repeat the run if joints meet their stops.

    Args:
        history_of: function that returns the torque history for a relative tolerance of the run.

    Raises:
        SimulationError: if the run cannot continue; ``run`` keeps the samples computed last.
    """
    tolerance, first = run.tolerance, run.progress
    times, duration = run.sample_times, run.duration
    mark = run.watch.mark() if run.watch is not None else None
    history = history_of(tolerance.relative)  # also sets the start of prescribed joints
    start = first.state.copy()
    run_open_loop(run, history)
    if first.impacts == 0 or (tolerance.relative, tolerance.absolute) != (RTOL, ATOL):
        return
    before, before_times = run.samples, run.sample_times
    run.begin_again()
    run.tolerance = tolerance._replace(relative=TIGHT * RTOL, absolute=TIGHT * ATOL)
    run.sample_times, run.duration = times, duration
    run.samples = np.empty((len(times), *start.shape))
    run.progress = Progress(0.0, start, 0.0)
    if run.watch is not None and mark is not None:
        run.watch = replace(run.watch, tolerance=run.tolerance)
        run.watch.restore(mark)
    if run.loads_of is not None:  # make the loads of the second run as accurate as its torque
        run.loads = run.loads_of(run.tolerance.relative)
    run_open_loop(run, history_of(run.tolerance.relative))
    run.discarded = first.evaluations
    apart = _apart(run, before, before_times, first.sample)
    reach = 1.0 / float(tolerance.unit[0, :, 0].min())
    parted = np.flatnonzero(~(apart <= _PARTED * reach))
    if parted.size:
        run.doubt = (
            f"impacts on joint stops amplify errors: the motions at rtol={RTOL:g} and at "
            f"rtol={TIGHT * RTOL:g} differ by {apart.max():.2g} m at the tip, and by 1 % of the "
            f"reach from t = {run.sample_times[parted[0]]:.4g} s on. Do not rely on this result "
            "after that time."
        )


def _apart(run: Run, before: FloatArray, before_times: FloatArray, count: int) -> FloatArray:
    """Return the tip difference (m) from the earlier samples; zero if the times differ."""
    count = min(count, run.progress.sample)
    same = before_times[:count] == run.sample_times[:count]  # an event may be the last sample
    apart = np.abs(before[:count, 0] - run.samples[:count, 0]) / run.tolerance.unit[0]
    largest: FloatArray = apart.max(axis=(1, 2)) * same
    return largest
