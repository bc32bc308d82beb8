"""Verified runs: joints that meet their stops, points that return to surfaces, and friction.

Each impact multiplies the errors made before it, by 5 to 20 with flexible links: an error of 1e-9
of the reach at the first impact is 1e-4 at the sixth, even if the impacts are located exactly. So
a run under a given torque is repeated with tighter tolerances until two runs agree to what the
requested ones promise, or it gets a warning with the estimated error.

Joints that turn far may whirl, which amplifies errors, too, and long vibrations add those of all
steps: at the default accuracy, such a run is compared with a cheaper one.

Contacts press and slide more often than they bounce, and amplify less. A run whose points return
to surfaces is therefore compared with a cheaper one of looser tolerances first.

With a fixed step, no step ends at an impact or where friction stops or releases a joint: such a run
is compared with one of half the step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.observe import contact_values, tips_of
from flexarm.base.errors import SimulationError
from flexarm.integrate import DormandPrince8, KennedyCarpenter5
from flexarm.integrate.base import FloatArray, Progress, Tolerance
from flexarm.integrate.reactions import reactions_many
from flexarm.kernels.columns import BRISTLE_ROOT, BRISTLED, COULOMB, COULOMB_EXCESS
from flexarm.kernels.forces.contact import GAP
from flexarm.kernels.layout import ArmConstants, Contacts
from flexarm.simulation.histories.loads import constants_with
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.default_step import default_step
from flexarm.simulation.run.events import Mark
from flexarm.simulation.run.integrator_choice import Choice, explicit_work
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import (
    TIGHT,
    joint_units,
    reach_of,
    scale_over_reach,
    share_of_finer,
)
from flexarm.simulation.run.work import Checkpoints as Checkpoints
from flexarm.simulation.run.work import run_open_loop

#: Tightest relative tolerance: below, rounding determines the error.
_TIGHTEST = 1e-13
#: Estimated error, as a part of the reach, above which a run through impacts gets a warning: this
#: many times the requested relative tolerance, but at least the second number, a hundredth of the
#: width of a line in a plot.
_PROMISED, _VISIBLE = 10.0, 1e-5
#: Estimated error of the finer of two runs over their difference, which is the error of the coarser
#: one: a power of the ratio of their tolerances, but at least the second number if the difference
#: exceeds the third one, a part of the reach. In trials errors were at most 8 % of it there. With
#: contacts it is the fourth one: while a point chatters, a difference does not grow beyond the
#: height of its rebounds, so that it says nothing about the power of the tolerance.
_POWER, _SHARE, _PARTED, _CHATTERED = 0.9, 0.1, 1e-2, 1e-3
#: The same with contacts, if nothing else is known: some of 100 random arms lost a short contact at
#: both tolerances, with errors of half the difference.
_AT_MOST = 0.5
#: Relative tolerance at which the rounding errors of a run are as large as those of its steps.
_ROUNDED = 3e-12
#: Ratio of the tolerances of a run and one that only verifies it, or of the later repetitions.
_RATIO = 1e2
#: Difference of a run with a fixed step from one with half the step, as a part of the reach, above
#: which it gets a warning.
_WRONG = 1e-3
#: Turn (rad) of a free joint, back and forth, or path of a slide over the reach, and path of a mode
#: as a displacement of the tip, over the reach, above which a run at the default accuracy is
#: compared with one whose tolerances are larger by a ratio; and errors over the accuracy above
#: which it is repeated with smaller tolerances, and above which that cannot help.
_FAR, _LASTING, LOOSER, _MISSED, _HOPELESS = 2.0 * np.pi, 0.3, 10.0, 3.0, 60.0
#: Gap between two contacts, as a part of the reach, below which a point only presses: with force
#: control it rebounds by up to 6e-4 and errors are below 2e-7 of the reach.
_LIFTED = 1e-3
#: Openings and closings after which a contact has closed twice.
_TWICE = 3


def run_through_impacts(
    run: Run, history_of: Callable[[float], PiecewiseCubic], checkpoints: Checkpoints | None = None
) -> Beginning:
    """Simulate under a torque; repeat the run with tighter tolerances if impacts require it.

    Returns the beginning of the run. The run gets a warning if its error remains larger than the
    tolerances promise. A fixed step is kept and compared with half of it.
    """
    requested = run.tolerance.relative
    beginning = run_to_slips(run, history_of, checkpoints)
    stops = meets_stops(run)
    impacts, allowed = stops or returns(run), allowed_error(requested, run.request)
    if not run.integrator.adaptive:
        if impacts or slides(run):
            _compare_with_half_the_step(run, beginning)
    elif impacts and 0.5 * requested < _TIGHTEST:
        _compare_with_looser(run, beginning, allowed)
    elif stops or (impacts and not _agrees_with_looser(run, beginning, allowed)):
        _tighten(run, beginning)
    elif not impacts and run.request is not None and run.settings.accuracy is None:
        _compare_growth(run, beginning, run.request)
    return beginning


def run_to_slips(
    run: Run, history_of: Callable[[float], PiecewiseCubic], checkpoints: Checkpoints | None = None
) -> Beginning:
    """Simulate under a torque; repeat the run with steps that end at its breaks to find slips."""
    history = history_of(run.tolerance.relative)  # also sets the start of prescribed joints
    beginning = Beginning.of(run, history_of, checkpoints)
    run_open_loop(run, history, checkpoints)
    if misses_slip(run):
        beginning.history_of = partial(stopping_at_breaks, history_of)
        beginning.repeat(run, 1.0)
        run_open_loop(run, beginning.history_of(run.tolerance.relative), checkpoints)
        if misses_slip(run):
            text = (
                "a joint sticks at a sample although friction cannot hold it: the slip is shorter "
                "than the steps. Pass its time in breaks, or use a smaller step."
            )
            run.doubt = joined(run.doubt, text)
    return beginning


def stopping_at_breaks(
    history_of: Callable[[float], PiecewiseCubic], relative: float
) -> PiecewiseCubic:
    """Return a history in which steps end at every break.

    A step that spans several of its pieces may miss a slip, or compute derivatives by torque
    samples inaccurately.
    """
    history = history_of(relative)
    return replace(history, stops=np.unique(history.breaks[history.breaks > 0.0]))


def misses_slip(run: Run) -> bool:
    """Return whether a joint rests around a sample at which friction cannot hold it.

    The step of a joint that sticks is long, and its stages may miss a short torque. With a fixed
    step, a slip begins at the end of its step, so that longer rests count.
    """
    history, fixed, search = run.history, not run.integrator.adaptive, run.default_step
    step = search.shortest if search is not None else run.integrator.step
    apart = float(step or 0.0) if fixed else 0.0
    parts = [part for _, part in run.parts()]
    return history is not None and any(_misses_slip(part, history, apart) for part in parts)


def _misses_slip(run: Run, history: PiecewiseCubic, step: float) -> bool:
    """Return whether a joint rests around a sample for longer than a step, as in `misses_slip`."""
    count, n = run.progress.sample, run.arm.assembly.bodies
    if not run.arm.assembly.has_sticking or count < 3:
        return False
    near = 1 + math.ceil(step / (run.sample_times[1] - run.sample_times[0]))
    angle, rate = np.moveaxis(run.samples[:count, :, :, 0], 1, 0)
    system = run.system(history)
    held = system.constants.holds * system.constants.free > 0.0
    still = (rate[:-1] == 0.0) & (rate[1:] == 0.0) & (angle[:-1] == angle[1:]) & held
    if len(still) < 2 * near:
        return False
    windows = np.lib.stride_tricks.sliding_window_view(still, 2 * near, axis=0)
    rests: NDArray[np.bool_] = np.all(windows, axis=-1)
    resting = np.flatnonzero(np.any(rests, axis=1))
    places = near + resting
    times, states = run.sample_times[places], run.samples[places]
    torques = run.arm.padded_torque(history.at(times))
    accelerations, motor = np.zeros(states[:, 0].shape), np.zeros((places.size, n))
    root, wrench = np.zeros((2, places.size, n, 3))
    closing = np.zeros((places.size, run.arm.closure_rows + 1))
    reactions_many(system, times, states, torques, accelerations, root, wrench, motor, closing)
    return bool(np.any(rests[resting] & (accelerations[:, :, 0] != 0.0)))


def _tighten(run: Run, beginning: Beginning) -> None:
    """Repeat a run with tighter tolerances until two runs agree, or warn of the error."""
    requested = beginning.tolerance.relative
    tight, factor, allowed = requested, TIGHT, allowed_error(requested, run.request)
    while True:
        before = run.samples, run.sample_times, run.progress.sample
        factor = max(factor, _TIGHTEST / tight)
        tight *= factor
        if not beginning.improves(run, tight / requested, tight):
            _compare_with_looser(run, beginning, allowed)
            return
        apart = difference(run, *before)
        error = _error_of_finer(apart, tight / factor, tight, _parted(run))
        if not np.any(error > allowed):
            return
        if 0.5 * tight < _TIGHTEST:
            break
        factor = 1.0 / _RATIO
    if apart.max() > _parted(run) and run.changes is None:
        # The difference of runs with such tolerances does not show which one is wrong.
        _compare_with_looser(run, beginning, allowed)
    else:
        _doubt(run, error, allowed)


def meets_stops(run: Run) -> bool:
    """Return whether a joint has met a stop; with a fixed step, whether it did in a sample."""
    limits = run.arm.assembly.constants.limits
    lower, upper, stiffness = limits[:, 0], limits[:, 1], limits[:, 2]
    if not stiffness.any():
        return False
    if run.integrator.adaptive:
        return run.progress.impacts > 0
    angle = run.samples[: run.progress.sample, 0, :, 0]
    return bool(np.any(((angle < lower) | (angle > upper)) & (stiffness > 0.0)))


def slides(run: Run) -> bool:
    """Return whether a joint that friction can hold moves in a sample."""
    rates = run.samples[: run.progress.sample, 1, :, 0]
    moving = rates[:, run.arm.assembly.constants.holds > 0.0].any()
    return run.arm.assembly.has_sticking and bool(moving)


def returns(run: Run) -> bool:
    """Return whether a point has left a surface and met it again; see ``returns_to_surface``."""
    touches = run.progress.touches if run.integrator.adaptive else None
    samples = run.samples[: run.progress.sample]
    return returns_to_surface(run.arm, run.loads.placed.contacts, samples, touches)


def returns_to_surface(
    arm: Arm, contacts: Contacts, samples: FloatArray, touches: int | None
) -> bool:
    """Return whether a point has left a surface by more than ``_LIFTED`` and met it again.

    ``touches``: number of openings and closings; None with a fixed step, which does not count them.
    """
    if not contacts.body.size or (touches is not None and touches < _TWICE):
        return False
    gap = contact_values(arm, contacts, samples)[..., GAP]
    inside = gap < 0.0
    if touches is not None and inside.sum() < 2:  # shorter than the time between two samples
        return True
    before = np.logical_or.accumulate(inside)
    after = np.logical_or.accumulate(inside[::-1])[::-1]
    return bool(np.any(before & after & (gap > _LIFTED * arm.reach)))


def may_grow(
    method: str,
    samples: FloatArray,
    constants: ArmConstants,
    unit: FloatArray,
    times: FloatArray,
    large: bool = False,
) -> bool:
    """Return whether a free joint turns far, or vibrations last, in samples (k, 2, n, 1 + m).

    With ``large`` tolerances a quarter of both counts: steps of 0.1 rad err in the same sense.
    """
    if len(samples) < 2:
        return False
    turns = np.abs(np.diff(samples[:, 0, :, 0], axis=0)).sum(axis=0)
    turns /= joint_units(constants)
    share = 0.25 if large else 1.0
    if np.any(turns[constants.free > 0.0] > share * _FAR):
        return True
    if method != KennedyCarpenter5.name:
        return False
    bending = times[len(samples) - 1] * np.abs(samples[:, 1, :, 1:]).mean(axis=0)
    path = bending / unit[0, :, 1:] * scale_over_reach(constants, unit)
    return bool(path.max(initial=0.0) > share * _LASTING)


def _compare_growth(run: Run, beginning: Beginning, request: float) -> None:
    """Compare a run whose errors may grow with a looser one, and repeat it or warn."""
    constants, count = constants_with(run.arm, run.prescribed), run.progress.sample
    unit, times = run.tolerance.unit, run.sample_times
    if not may_grow(run.integrator.name, run.samples[:count], constants, unit, times):
        return
    other = second_run(run, beginning, tolerance=scaled(run.tolerance, LOOSER))
    if other is None:
        return
    error = growth_error(run.arm, run.samples[:count], other.samples[: other.progress.sample])
    if repeats_growth(error, request):
        before, factor = run.samples[:count], 1.0 / LOOSER
        if beginning.improves(run, factor, factor * beginning.tolerance.relative):
            error = growth_error(run.arm, run.samples[: run.progress.sample], before)
    run.doubt = joined(run.doubt, doubt_of_growth(run.arm, times, error, request))


def growth_error(arm: Arm, samples: FloatArray, others: FloatArray) -> FloatArray:
    """Estimate the error (k,) of the tip in samples (k, 2, n, 1 + m), over the reach."""
    count = min(len(samples), len(others))
    tips = (tips_of(arm, states[:count])[:, :2] for states in (samples, others))
    return np.asarray(share_of_finer(LOOSER) / reach_of(arm) * np.hypot(*np.subtract(*tips).T))


def repeats_growth(error: FloatArray, request: float) -> bool:
    """Return whether a run misses the accepted error so little that a repetition reaches it."""
    return bool(_MISSED * request < error.max(initial=0.0) < _HOPELESS * request)


def doubt_of_growth(arm: Arm, times: FloatArray, error: FloatArray, request: float) -> str:
    """Return the warning of a run whose errors may grow; empty if its error is small enough."""
    cause, remedy = "errors grow in this motion", ": state the accuracy that you need"
    return _text(arm, times, error, _MISSED * request, cause, remedy)


def allowed_error(relative: float, request: float | None) -> float:
    """Return the error, as a part of the reach, above which a run through impacts is doubtful."""
    allowed = _PROMISED * relative
    return max(allowed if request is None else min(allowed, _MISSED * request), _VISIBLE)


@dataclass
class Beginning:
    """What repetitions of a run begin with."""

    choice: Choice
    tolerance: Tolerance
    state: FloatArray  # (2, n, 1 + m)
    times: FloatArray  # (samples,) s
    duration: float
    mark: Mark | None
    history_of: Callable[[float], PiecewiseCubic] | None  # as in `run_through_impacts`
    checkpoints: Checkpoints | None  # likewise

    @classmethod
    def of(
        cls,
        run: Run,
        history_of: Callable[[float], PiecewiseCubic] | None = None,
        checkpoints: Checkpoints | None = None,
    ) -> Beginning:
        """Return the beginning of a run that has not started."""
        mark = run.watch.mark() if run.watch is not None else None
        known = run.choice, run.tolerance, run.progress.state.copy(), run.sample_times
        return cls(*known, run.duration, mark, history_of, checkpoints)

    def repeat(self, run: Run, factor: float) -> None:
        """Return a run to its beginning, with tolerances multiplied by ``factor``."""
        self.restore(run, _choice_of_repetition(run, self, factor), scaled(self.tolerance, factor))

    def improves(self, run: Run, factor: float, relative: float) -> bool:
        """Repeat a run, with tolerances multiplied by ``factor``; return whether that succeeds.

        Otherwise the run has the same result as before. ``relative``: tolerance of its torque.
        """
        assert self.history_of is not None
        log = run.watch.log if run.watch is not None else None
        completed = [
            (owner, {k: v.copy() if isinstance(v, list) else v for k, v in vars(owner).items()})
            for owner in (run, log, run.changes, self.checkpoints)
            if owner is not None
        ]
        self.repeat(run, factor)
        try:
            run_open_loop(run, self.history_of(relative), self.checkpoints)
        except SimulationError:
            for owner, values in completed:
                vars(owner).update(values)
            return False
        return True

    def restore(self, run: Run, choice: Choice, tolerance: Tolerance) -> None:
        """Return a run to its beginning, with another integrator and tolerance."""
        run.discarded += run.progress.evaluations
        run.begin_again()
        run.choice, run.integrator, run.doubt = choice, choice.integrator, choice.doubt
        run.tolerance = tolerance
        run.default_step = default_step(run.integrator, run.tolerance)
        run.sample_times, run.duration = self.times, self.duration
        run.samples = np.empty((len(self.times), *self.state.shape))
        run.progress = Progress(0.0, self.state.copy(), 0.0)
        if run.watch is not None and self.mark is not None:
            run.watch = replace(run.watch, integrator=run.integrator, tolerance=run.tolerance)
            run.watch.restore(self.mark)
        if run.loads_of is not None:  # make the loads as accurate as the torque
            run.loads = run.loads_of(run.tolerance.relative)

    def again(self, run: Run, **changed: Any) -> Run:
        """Return a run from the same beginning that only verifies ``run``: it logs no events."""
        progress, samples = Progress(0.0, self.state.copy(), 0.0), np.empty_like(run.samples)
        return replace(run, progress=progress, samples=samples, watch=None, **changed)


def scaled(tolerance: Tolerance, factor: float) -> Tolerance:
    """Return a tolerance multiplied by ``factor``."""
    absolute, relative = factor * tolerance.absolute, factor * tolerance.relative
    return tolerance._replace(absolute=absolute, relative=relative)


def _choice_of_repetition(run: Run, beginning: Beginning, factor: float) -> Choice:
    """Return the integrator of a repetition, before the work of a trial counts.

    Bristles of a sliding joint make an explicit method expensive, and tight tolerances one of
    order 5: the first run has shown how fast the joints slide.
    """
    choice, c = beginning.choice, run.arm.assembly.constants
    if not (choice.open and run.arm.assembly.has_bristles):
        return choice
    rates = np.abs(run.samples[: run.progress.sample, 1, :, 0]).max(axis=0, initial=0.0)
    b = c.body[c.body[:, BRISTLED] > 0.0]
    level = b[:, COULOMB] + np.minimum(b[:, COULOMB_EXCESS], 0.0)
    sliding = b[:, BRISTLE_ROOT] ** 2 * rates[c.body[:, BRISTLED] > 0.0] / level
    explicit = explicit_work(max(choice.fastest, float(sliding.max())), run.progress.time)
    order = KennedyCarpenter5.order
    if explicit < run.progress.evaluations * factor ** (-1.0 / order):
        reason = "order 8 with step control: fewest evaluations at tolerances that impacts require"
        return choice._replace(integrator=DormandPrince8(), reason=reason, open=False)
    return choice


def difference(run: Run, before: FloatArray, before_times: FloatArray, count: int) -> FloatArray:
    """Return the tip difference from earlier samples, as a part of the reach.

    It is zero where the times differ: an event may be the last sample.
    """
    count = min(count, run.progress.sample)
    same = before_times[:count] == run.sample_times[:count]
    unit = run.tolerance.unit
    apart = np.abs(before[:count, 0] - run.samples[:count, 0]) / unit[0]
    share = scale_over_reach(run.arm.assembly.constants, unit)
    return np.asarray(apart.max(axis=(1, 2)) * same * share)


def _parted(run: Run) -> float:
    """Return the difference, as a part of the reach, above which two runs have parted."""
    return _CHATTERED if run.loads.placed.contacts.body.size else _PARTED


def _gain(coarse: float, fine: float) -> float:
    """Return the error at a relative tolerance over that at a coarser one."""
    gain: float = ((fine + _ROUNDED) / (coarse + _ROUNDED)) ** _POWER
    return gain


def _error_of_finer(apart: FloatArray, coarse: float, fine: float, parted: float) -> FloatArray:
    """Estimate the error of the finer of two runs, from their difference and their tolerances."""
    gain = _gain(coarse, fine)
    share = np.where(apart > parted, max(_SHARE, gain), gain)
    return np.asarray(np.where(np.isfinite(apart), apart * share, np.inf))


def _doubt(run: Run, error: FloatArray, allowed: float, remedy: str = "") -> None:
    """Warn of an estimated error, as a part of the reach at the samples, above the allowed one."""
    text = _text(run.arm, run.sample_times, error, allowed, _cause(run), remedy)
    run.doubt = joined(run.doubt, text)


def _text(
    arm: Arm, times: FloatArray, error: FloatArray, allowed: float, cause: str, remedy: str
) -> str:
    """Return the warning of an estimated error; empty if it is at most the allowed one."""
    large = np.flatnonzero(error > allowed)
    if not large.size:
        return ""
    reach = reach_of(arm)
    return (
        f"{cause}: the error of the tip is about {reach * min(error.max(), 2.0):.1g} m, and above "
        f"{reach * allowed:.1g} m from t = {times[large[0]]:.4g} s on. Do not rely on this result "
        f"after that time{remedy}."
    )


def joined(*texts: str) -> str:
    """Return the texts that are not empty as one text."""
    return " ".join(filter(None, texts))


def _cause(run: Run) -> str:
    """Return why the error of a run may exceed that of its steps."""
    if meets_stops(run):
        return "impacts on joint stops amplify errors"
    if returns(run):
        return "impacts on surfaces amplify errors"
    return "a fixed step may miss where friction stops or releases a joint"


def loop_comparison(
    run: Run, repetition: Callable[[], Callable[[Run], None]]
) -> Callable[[], None]:
    """Return a function that warns, after a run with a controller, if its impacts repeat.

    Call it before the run, because a controller may keep what it learns.
    """
    stops = run.arm.assembly.constants.limits[:, 2].any()
    impacts = stops or run.loads.placed.contacts.body.size
    if impacts and run.integrator.adaptive and run.changes is None:
        with suppress(Exception):  # a controller that cannot be copied
            return partial(_compare_loops, run, Beginning.of(run), repetition())
    return lambda: None


def _compare_loops(run: Run, beginning: Beginning, execute: Callable[[Run], None]) -> None:
    """Warn if impacts repeat in a run with a controller and its error is too large."""
    tolerance = beginning.tolerance
    if not (meets_stops(run) or returns(run)):
        return
    # Steps end at sample times, so that tolerances that differ little lead to the same steps.
    factor, share = max(TIGHT, _TIGHTEST / tolerance.relative), 1.0
    if factor > 0.5:
        factor, share = _RATIO, _gain(_RATIO * tolerance.relative, tolerance.relative)
    other = beginning.again(run, tolerance=scaled(tolerance, factor))
    try:
        execute(other)
    except Exception:  # a controller that cannot run twice
        return
    run.discarded += other.progress.evaluations
    apart = difference(run, other.samples, other.sample_times, other.progress.sample)
    remedy = "" if factor > 1.0 else ", or use smaller rtol and atol"
    _doubt(run, share * apart, allowed_error(tolerance.relative, run.request), remedy)


def _compare_with_half_the_step(run: Run, beginning: Beginning) -> None:
    if run.default_step is not None or run.integrator.step is None:
        return  # its search has compared two steps
    half = replace(run.integrator, step=0.5 * run.integrator.step)
    apart = _verify(run, beginning, integrator=half)
    _doubt(run, apart, _WRONG, ": use a shorter step or integrator='auto'")


def _compare_with_looser(run: Run, beginning: Beginning, allowed: float) -> None:
    apart = _verify(run, beginning, tolerance=scaled(run.tolerance, _RATIO))
    if not apart.size:
        text = f"{_cause(run)}, and that of the tip is not known: no second run verifies this one."
        run.doubt = joined(run.doubt, text)
        return
    tight = run.tolerance.relative
    error = _error_of_finer(apart, _RATIO * tight, tight, _parted(run))
    # Once two runs have parted, their difference is the best estimate.
    _doubt(run, np.where(apart > _parted(run), apart, error), allowed)


def _agrees_with_looser(run: Run, beginning: Beginning, allowed: float) -> bool:
    """Return whether a run differs little from one with looser tolerances."""
    apart = _verify(run, beginning, tolerance=scaled(run.tolerance, _RATIO))
    return apart.size > 0 and bool(np.all(_AT_MOST * apart <= allowed))


def _verify(run: Run, beginning: Beginning, **changed: Any) -> FloatArray:
    """Return the difference from a second run; nothing if the arm changes or that run fails."""
    other = second_run(run, beginning, **changed)
    if other is None:
        return np.zeros(0)
    return difference(run, other.samples, other.sample_times, other.progress.sample)


def second_run(run: Run, beginning: Beginning, **changed: Any) -> Run | None:
    """Return a second run from the same beginning; None if the arm changes or it fails."""
    if run.changes is not None or run.history is None:
        return None
    other = beginning.again(run, **changed)
    try:
        other.carry_to(other.system(run.history), run.duration)
    except SimulationError:
        return None
    run.discarded += other.progress.evaluations
    return other
