"""Runs of smooth arms with large tolerances, which a second run verifies.

An accepted error says what the tolerances may cause in the whole run. Where nothing acts suddenly,
steps of order 5 with bending implicit reach it with a third of its tolerance; only errors that
grow, or add over long vibrations, need more. A run with ten times the tolerance shows which run is
which, at half the cost: both together take fewer evaluations than one run that is safe for all
motions (docs/performance/measure_accuracy.py).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm
from flexarm.base.errors import SimulationError
from flexarm.integrate import KennedyCarpenter5
from flexarm.integrate.base import Status, System, Tolerance
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.impacts import LOOSER, Beginning, growth_error, scaled, second_run
from flexarm.simulation.run.integrator_choice import Choice, explicit_work
from flexarm.simulation.run.settings import RunSettings, request_of
from flexarm.simulation.run.small_motion import run_closely, small_motion
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import absolute_tolerance
from flexarm.simulation.run.work import EVALUATIONS_A_STEP

#: Relative tolerance over the accepted error, and the largest. At 1 instead of 0.3 a quarter of
#: runs must be repeated.
_SHARE, _LARGEST = 0.3, 0.1
#: Least accepted error over the reach: at 1e-8 both runs take half of the evaluations of one with
#: small tolerances, at 1e-9 as many (30 arms, median).
_LEAST = 1e-8
#: Exponents of two of the least and the most attempted steps: a few milliseconds, and less than
#: lanes make. Arms of tests/accuracy_runs.py need at most 0.9 times the least evaluations of an
#: explicit method, and those that turn and whirl fast, whose errors grow, three to six times.
_STEPS = 8, 17
_REASON = "order 5 with bending implicit: a second run shows that it is accurate"


def run_accurately(run: Run, history_of: Callable[[float], PiecewiseCubic]) -> None:
    """Simulate under a torque with the accuracy that its settings promise."""
    sudden = run.loads.placed.contacts.body.size or run.changes is not None
    relative = coarse_tolerance(run.settings, run.arm)
    if (
        relative is None
        or sudden
        or run.watch is not None
        or not _run_coarsely(run, history_of, relative)
    ):
        run_closely(run, history_of)


@once_per_arm
def is_smooth(arm: Arm) -> bool:
    """Return whether an arm bends, and nothing in its joints acts suddenly."""
    sudden = ("friction", "limits", "backlash", "winding")
    joints = any(getattr(joint, name) for joint in arm.spec.joints for name in sudden)
    return bool(arm.assembly.constants.w2.any()) and not joints and not arm.closure_rows


def coarse_tolerance(settings: RunSettings, arm: Arm) -> float | None:
    """Return the relative tolerance of a run without sudden loads; None if it must be small."""
    request = request_of(settings, arm)
    automatic = settings.integrator == "auto" and settings.step is None
    if request is None or request < _LEAST or not automatic or not is_smooth(arm):
        return None
    return min(_SHARE * request, _LARGEST)


def coarse(tolerance: Tolerance, arm: Arm, relative: float) -> Tolerance:
    """Return the tolerance of a run with a large relative one."""
    absolute, _ = absolute_tolerance(arm, None, relative)
    return tolerance._replace(absolute=absolute, relative=relative)


def coarse_choice(fastest: float) -> Choice:
    """Return the integrator of a run with large tolerances; ``fastest``: see `fastest_of`."""
    return Choice(KennedyCarpenter5(), _REASON, fastest=fastest)


def most_steps(fastest: float, duration: float) -> int:
    """Return the attempted steps of a run with large tolerances; ``fastest``: see `fastest_of`.

    They are those of as many evaluations as an explicit method needs at least, in powers of two, so
    that lanes advance many runs together.
    """
    steps = explicit_work(fastest, duration) / EVALUATIONS_A_STEP
    return int(2.0 ** np.clip(np.round(np.log2(steps)), *_STEPS))


def _run_coarsely(run: Run, history_of: Callable[[float], PiecewiseCubic], relative: float) -> bool:
    """Simulate with a large tolerance; return whether a second run agrees, else begin again."""
    run.history = history_of(relative)  # also sets the start of prescribed joints
    beginning, request, pause = Beginning.of(run, history_of), run.request, run.max_steps
    assert request is not None
    fastest, tolerance = run.choice.fastest, coarse(run.tolerance, run.arm, relative)
    run.choice, run.tolerance, run.doubt = coarse_choice(fastest), tolerance, ""
    run.integrator, other = run.choice.integrator, None
    with suppress(SimulationError):
        if _reaches_end(run, run.system(run.history), most_steps(fastest, run.duration)):
            run.max_steps = pause
            other = second_run(run, beginning, tolerance=scaled(tolerance, LOOSER))
    samples, steps = run.samples[: run.progress.sample], run.progress.steps
    if other is not None and small_motion(tolerance, relative, True, samples, steps) is None:
        others = other.samples[: other.progress.sample]
        error = float(growth_error(run.arm, samples, others).max(initial=0.0))
        if error <= request:
            run.error = error
            return True
    run.max_steps = pause
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
