"""Runs of smooth arms with a requested accuracy: large tolerances that a second run verifies.

Where nothing acts suddenly, steps of order 5 with bending implicit reach the requested error of the
tip at a tolerance of a third of it, unless errors grow, or add over long vibrations. A run with ten
times the tolerance, at half the cost, shows whether they do (docs/performance/measure_accuracy.py).
Velocities, forces and energies of samples between long steps err more than positions, so that runs
without a request keep small tolerances.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm
from flexarm.arm.observe import tips_of
from flexarm.base.errors import SimulationError
from flexarm.integrate import KennedyCarpenter5
from flexarm.integrate.base import FloatArray, Status, System, Tolerance
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.impacts import LOOSER, Beginning, scaled, second_run
from flexarm.simulation.run.integrator_choice import Choice, explicit_work
from flexarm.simulation.run.settings import RunSettings, relative_tolerance
from flexarm.simulation.run.small_motion import run_closely, small_motion
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import absolute_tolerance, reach_of, share_of_finer
from flexarm.simulation.run.work import EVALUATIONS_A_STEP
from flexarm.simulation.run.work import choose as choose_closely

#: Relative tolerance over the requested error of the tip, and the largest. At 1 instead of 0.3 a
#: quarter of runs must be repeated.
_ASKED, _MOST = 0.3, 0.1
#: Steps over those of the second run, 1.6 at order 5, below which both are limited by something
#: else, such as samples of the torque, and their difference says nothing.
_FEWER = 1.3
#: Least accepted error over the reach: at 1e-8 both runs take half of the evaluations of one with
#: small tolerances, at 1e-9 as many (30 arms, median).
_LEAST = 1e-8
#: Most evaluations over the least ones of an explicit method, of which order 8 takes four to eight
#: times as many at small tolerances. Arms of tests/accuracy_runs.py need at most 0.9 times as many,
#: and those that turn and whirl fast, whose errors grow, three to six times.
_EVALUATIONS = 2.0**1.5
#: Exponents of two of the least and the most attempted steps: a few milliseconds, and less than
#: lanes make.
_STEPS = 8, 17
_REASON = "order 5 with bending implicit: a second run verifies it"


def run_accurately(run: Run, history_of: Callable[[float], PiecewiseCubic]) -> None:
    """Simulate under a torque with the accuracy that its settings promise."""
    relative = _tolerance_of(run)
    if relative is None or not _succeeds(run, history_of, relative):
        run_closely(run, history_of)


def choose(run: Run, history_of: Callable[[float], PiecewiseCubic]) -> Choice:
    """Return the integrator of a run; one with large tolerances is executed, others are not."""
    relative = _tolerance_of(run)
    if relative is None or not _succeeds(run, history_of, relative):
        choose_closely(run, history_of(relative_tolerance(run.settings, run.arm)))
    return run.choice


def _tolerance_of(run: Run) -> float | None:
    """Return the large relative tolerance of a run; None if it must be small."""
    sudden = run.loads.placed.contacts.body.size or run.changes or run.watch
    return None if sudden else coarse_tolerance(run.settings, run.arm)


@once_per_arm
def is_smooth(arm: Arm) -> bool:
    """Return whether an arm bends, has one tip, and nothing in its joints acts suddenly."""
    sudden, constants = ("friction", "limits", "backlash", "winding"), arm.assembly.constants
    joints = any(getattr(joint, name) for joint in arm.spec.joints for name in sudden)
    chain = np.array_equal(constants.parent, np.arange(-1, len(constants.parent) - 1))
    return bool(constants.w2.any()) and chain and not joints and not arm.closure_rows


def coarse_tolerance(settings: RunSettings, arm: Arm) -> float | None:
    """Return the relative tolerance of a run without sudden loads; None if it must be small."""
    if settings.accuracy is None or settings.integrator != "auto" or not is_smooth(arm):
        return None
    request = settings.accuracy / reach_of(arm)
    return None if request < _LEAST else min(float(f"{_ASKED * request:.12g}"), _MOST)


def coarse(tolerance: Tolerance, arm: Arm, relative: float) -> Tolerance:
    """Return the tolerance of a run with a large relative one."""
    absolute, _ = absolute_tolerance(arm, None, relative)
    return tolerance._replace(absolute=absolute, relative=relative)


def coarse_choice(fastest: float) -> Choice:
    """Return the integrator of a run with large tolerances; ``fastest``: see `fastest_of`."""
    return Choice(KennedyCarpenter5(), _REASON, fastest=fastest)


def coarse_errors(
    arm: Arm, samples: FloatArray, others: FloatArray, steps: NDArray[np.int64]
) -> FloatArray:
    """Estimate errors (runs,) of the tip, over the reach, in samples (runs, k, 2, n, 1 + m).

    ``others`` are those of ten times the tolerance, ``steps`` (2, runs) those of both. The error is
    infinite if the steps differ little.
    """
    count = min(samples.shape[1], others.shape[1])
    both = (states[:, :count].reshape(-1, *states.shape[2:]) for states in (samples, others))
    apart = np.subtract(*(tips_of(arm, states)[:, :2] for states in both))
    largest = np.hypot(*apart.T).reshape(-1, count).max(axis=1, initial=0.0)
    errors = share_of_finer(LOOSER) / reach_of(arm) * largest
    return np.where(are_alike(*steps), np.inf, errors)


def are_alike(steps: Any, others: Any) -> Any:
    """Return whether steps are hardly more than those of a run with ten times the tolerance."""
    return steps < _FEWER * others


def most_steps(fastest: float, duration: float) -> int:
    """Return the attempted steps of a run with large tolerances; ``fastest``: see `fastest_of`.

    They are powers of two, so that lanes advance many runs together.
    """
    steps = _EVALUATIONS * explicit_work(fastest, duration) / EVALUATIONS_A_STEP
    return int(2.0 ** np.clip(np.round(np.log2(steps)), *_STEPS))


def _succeeds(run: Run, history_of: Callable[[float], PiecewiseCubic], relative: float) -> bool:
    """Simulate with a large tolerance; return whether a second run agrees, else begin again."""
    # The history also sets the start of prescribed joints.
    run.history = history_of(relative)
    beginning, pause = Beginning.of(run, history_of), run.max_steps
    fastest, tolerance = run.choice.fastest, coarse(run.tolerance, run.arm, relative)
    run.choice, run.tolerance, run.doubt = coarse_choice(fastest), tolerance, ""
    run.integrator, other = run.choice.integrator, None
    with suppress(SimulationError):
        if _reaches_end(run, run.system(run.history), most_steps(fastest, run.duration)):
            run.max_steps = pause
            other = second_run(run, beginning, tolerance=scaled(tolerance, LOOSER))
    samples, steps = run.samples[: run.progress.sample], run.progress.steps
    if other is not None and small_motion(tolerance, relative, True, samples, steps) is None:
        pair = samples[None], other.samples[None, : other.progress.sample]
        both = np.array([[steps], [other.progress.steps]])
        error = float(coarse_errors(run.arm, *pair, both)[0])
        if run.request is not None and error <= run.request:
            run.error = error
            return True
    run.max_steps, run.history = pause, None
    beginning.restore(run, beginning.choice, beginning.tolerance)
    return False


def _reaches_end(run: Run, system: System, most: int) -> bool:
    """Advance a run to its end; return whether a number of attempted steps is enough."""
    progress = run.progress
    while (left := most - progress.steps - progress.rejected) > 0:
        run.max_steps = min(run.max_steps, left)
        target = run.duration, run.sample_times, run.samples
        system, status = run.advance(system, progress, *target)
        if status != Status.PAUSED:
            return status == Status.DONE
    return False
