"""Runs of smooth arms with large tolerances, which a second run verifies where errors may grow.

An accepted error says what the tolerances may cause in the whole run. Where nothing acts suddenly,
steps of order 5 with bending implicit reach it with a third of its tolerance; only errors that
grow, or add over long vibrations, need more. A run with ten times the tolerance, at half the cost,
shows whether they do (docs/performance/measure_accuracy.py). It follows where joints turn far or
vibrations last, and wherever the user has asked for an accuracy.
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
from flexarm.kernels.columns import MODE_DAMPING, W2
from flexarm.simulation.histories.loads import constants_with
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.impacts import LOOSER, Beginning, may_grow, scaled, second_run
from flexarm.simulation.run.integrator_choice import Choice, explicit_work
from flexarm.simulation.run.settings import RunSettings, relative_tolerance, request_of
from flexarm.simulation.run.small_motion import run_closely, small_motion
from flexarm.simulation.run.stepping import Run, accelerations_at
from flexarm.simulation.run.tolerance import absolute_tolerance, reach_of, share_of_finer, tip_units
from flexarm.simulation.run.work import EVALUATIONS_A_STEP
from flexarm.simulation.run.work import choose as choose_closely

#: Relative tolerance over the accepted error of the tip, that of a run whose user has not asked for
#: one, and the largest. At 1 instead of 0.3 a quarter of runs must be repeated. Without a request,
#: bending and forces count, too: they err by 3e-5 and 6e-4 of their largest values on damped arms
#: (median), and twice as much at 0.3, with two thirds of the evaluations.
_ASKED, _UNASKED, _MOST = 0.3, 0.1, 0.1
#: Error of the velocity of the tip over its largest value, less than a line in a plot. Rates of
#: fast vibrations err more than positions.
_VELOCITY = 3e-3
#: Steps over those of the second run, 1.6 at order 5, below which both are limited by something
#: else, such as samples of the torque, and their difference says nothing.
_FEWER = 1.3
#: Least accepted error over the reach: at 1e-8 both runs take half of the evaluations of one with
#: small tolerances, at 1e-9 as many (30 arms, median).
_LEAST = 1e-8
#: Most evaluations over the least ones of an explicit method, of which order 8 takes four to eight
#: times as many at small tolerances. Most arms need at most 1.5 times as many, and those that turn
#: and whirl fast, whose errors grow, three to six times.
_EVALUATIONS = 2.0**1.5
#: Decay over frequency, twice the damping ratio, of vibrations that hardly decay; and amplitude of
#: one that begins suddenly, as a displacement of the tip over the reach. Without damping, joint
#: forces after a step of the torque err by up to 0.7 of their largest value, with damping by 0.03.
_DECAY, _SUDDEN = 0.01, 1e-5
#: Exponents of two of the least and the most attempted steps: a few milliseconds, and less than
#: lanes make.
_STEPS = 8, 17
_REASON = "order 5 with bending implicit: a second run verifies it if necessary"


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
    request = request_of(settings, arm)
    automatic = settings.integrator == "auto" and settings.step is None
    if request is None or request < _LEAST or not automatic or not is_smooth(arm):
        return None
    share = _UNASKED if settings.accuracy is None else _ASKED
    return min(float(f"{share * request:.12g}"), _MOST)


def coarse(tolerance: Tolerance, arm: Arm, relative: float) -> Tolerance:
    """Return the tolerance of a run with a large relative one."""
    absolute, _ = absolute_tolerance(arm, None, relative)
    return tolerance._replace(absolute=absolute, relative=relative)


def coarse_choice(fastest: float) -> Choice:
    """Return the integrator of a run with large tolerances; ``fastest``: see `fastest_of`."""
    return Choice(KennedyCarpenter5(), _REASON, fastest=fastest)


def coarse_errors(
    arm: Arm,
    samples: FloatArray,
    others: FloatArray,
    steps: NDArray[np.int64],
    settings: RunSettings,
) -> FloatArray:
    """Estimate errors (runs,) of the tip, over the reach, in samples (runs, k, 2, n, 1 + m).

    ``others`` are those of ten times the tolerance, ``steps`` (2, runs) those of both. The error is
    infinite if the steps differ little, and without a request if the velocity of the tip errs
    visibly.
    """
    count = min(samples.shape[1], others.shape[1])
    tips = [
        tips_of(arm, states[:, :count].reshape(-1, *states.shape[2:])).reshape(-1, count, 6)
        for states in (samples, others)
    ]
    apart = share_of_finer(LOOSER) * np.abs(np.subtract(*tips)).max(axis=1, initial=0.0)
    errors = np.hypot(apart[:, 0], apart[:, 1]) / reach_of(arm)
    speed = np.hypot(tips[0][:, :, 3], tips[0][:, :, 4]).max(axis=1, initial=0.0)
    visible = np.hypot(apart[:, 3], apart[:, 4]) > _VELOCITY * speed
    wrong = visible & (settings.accuracy is None) | are_alike(*steps)
    return np.where(wrong, np.inf, errors)


def are_alike(steps: Any, others: Any) -> Any:
    """Return whether steps are hardly more than those of a run with ten times the tolerance."""
    return steps < _FEWER * others


def most_steps(fastest: float, duration: float, stops: int) -> int:
    """Return the attempted steps of a run with large tolerances; ``fastest``: see `fastest_of`.

    They are powers of two, so that lanes advance many runs together; none if steps that end at
    ``stops`` times take more.
    """
    steps = _EVALUATIONS * explicit_work(fastest, duration) / EVALUATIONS_A_STEP
    most = int(2.0 ** np.clip(np.round(np.log2(steps)), *_STEPS))
    return most if 2 * stops < most else 0


def is_sudden(
    settings: RunSettings, arm: Arm, system: System, history: PiecewiseCubic, state: FloatArray
) -> bool:
    """Return whether vibrations that hardly decay begin suddenly.

    Long steps lose fast vibrations, which hardly move the tip and carry forces of joints.
    """
    modes, stops = arm.assembly.constants.mode, system.drive.stops
    square = modes[..., W2]
    lasting = (square > 0.0) & (modes[..., MODE_DAMPING] < _DECAY * np.sqrt(square))
    if settings.accuracy is not None or not lasting.any():
        return False
    if stops.size:
        return True
    start = np.zeros(1)
    bend = accelerations_at(arm, system, start, state[None], history.at(start))[0, :, 1:]
    square = np.where(lasting, square, np.inf)
    size = np.abs(bend) / square + np.abs(state[1, :, 1:]) / np.sqrt(square)
    return bool((size / tip_units(arm)[0, :, 1:]).max() > _SUDDEN * reach_of(arm))


def _succeeds(run: Run, history_of: Callable[[float], PiecewiseCubic], relative: float) -> bool:
    """Simulate with a large tolerance; return whether it is accurate enough, else begin again."""
    # The history also sets the start of prescribed joints.
    run.history = history_of(relative)
    beginning, pause = Beginning.of(run, history_of), run.max_steps
    fastest, tolerance = run.choice.fastest, coarse(run.tolerance, run.arm, relative)
    run.choice, run.tolerance, run.doubt = coarse_choice(fastest), tolerance, ""
    run.integrator = run.choice.integrator
    system, good = run.system(run.history), False
    most = most_steps(fastest, run.duration, len(system.drive.stops))
    with suppress(SimulationError):
        if not is_sudden(run.settings, run.arm, system, run.history, run.progress.state):
            good = _reaches_end(run, system, most)
    run.max_steps = pause
    samples, steps = run.samples[: run.progress.sample], run.progress.steps
    if good and small_motion(run.arm, tolerance, relative, True, samples, steps) is None:
        constants = constants_with(run.arm, run.prescribed)
        seen = run.integrator.name, samples, constants, tolerance.unit, run.sample_times
        if run.settings.accuracy is None and not may_grow(*seen, large=True):
            return True
        other = second_run(run, beginning, tolerance=scaled(tolerance, LOOSER))
        if other is not None:
            pair = samples[None], other.samples[None, : other.progress.sample]
            both = np.array([[steps], [other.progress.steps]])
            error = float(coarse_errors(run.arm, *pair, both, run.settings)[0])
            if run.request is not None and error <= run.request:
                run.error = error
                return True
    run.history = None
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
