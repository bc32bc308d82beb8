"""Simulation of an arm over a given duration: ``flexarm.simulate``."""

from __future__ import annotations

import copy
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias, Unpack

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    FlexarmWarning,
    InputError,
    LargeDeflectionWarning,
    SimulationError,
    UnstableLoopWarning,
    public_call,
    warn_caller,
    without_warnings,
)
from flexarm.base.late import xr
from flexarm.base.user_functions import FunctionError
from flexarm.model.plausible import warn_of
from flexarm.model.scenarios.scenario import DURATION, FAILURE
from flexarm.simulation.calls.limits import add_limits, limits_of_run, notices_of, sag_warning
from flexarm.simulation.calls.preparation import (
    RunArguments,
    Situation,
    implausible_run,
    situation_of,
)
from flexarm.simulation.calls.result import add_loop, channels_of_run, exceeded_bound, make_result
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.loop.control_loop import ClosedLoop
from flexarm.simulation.loop.stability import AnalysedLoop, Stability, stability
from flexarm.simulation.run.changes import change_variables
from flexarm.simulation.run.coarse import are_alike, coarse_tolerance, run_accurately
from flexarm.simulation.run.events import event_variables
from flexarm.simulation.run.impacts import loop_comparison
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings, replaced, with_keywords
from flexarm.simulation.run.stepping import Notices, Run
from flexarm.simulation.run.tolerance import LEAST, reach_of, share_of_finer, tolerance_of_request

#: The result and the warnings of a run.
_Outcome: TypeAlias = "tuple[xr.Dataset, Notices]"


def _keep_result(failed: FunctionError, again: Callable[[], xr.Dataset]) -> None:
    """Attach the result of a shorter run; if that fails even earlier, raise its own error."""
    with without_warnings(LargeDeflectionWarning):
        try:
            failed.result = again()
        except InputError:  # the time is shorter than the given step
            return
    failed.result.attrs |= {"failure": str(failed), "ended_by": FAILURE}


@public_call
@with_keywords(RunArguments, Situation)
def simulate(
    arm: Arm,
    duration: float,
    *,
    settings: RunSettings | None = None,
    **arguments: Unpack[RunArguments],
) -> xr.Dataset:
    """Simulate an arm and return its motion as a labelled dataset.

    Args:
        arm: the arm; with ``plant`` given, the controller's model of the arm.
        duration: s, positive.
        torque: joint torques, zero by default. An array (samples, joints) at ``rate``, N m, from
            time zero, with the last row constant to the end of the run; or a function of time that
            returns (joints,). A function is approximated within the run's tolerance, except for
            features shorter than ``1 / rate`` that ``breaks`` does not contain.
        controller: evaluated at its sample time, with the torque constant in between (see
            ``flexarm.Controller``); instead of ``torque``.
        reference: motion for the controller; the arm starts at its beginning.
        plant: simulated arm, if it differs from ``arm``.
        hardware: instruments and motors between controller and arm; None for exact sensors of joint
            angles, rates and strain, and motors that apply the commanded torque exactly.
        prescribed: joints, by number from 1, that follow a prescribed motion exactly; ``torque`` of
            the result is the torque that this requires. Cannot be combined with a controller.
        initial: q (dof,), by default straight links at the start of the reference, or of
            ``torque`` if that is computed from a motion, else all angles zero.
        initial_rate: qd (dof,), zero by default. Bristles of friction start without deflection:
            with them, q and qd at the end of a run do not continue it. A `Plant` does.
        tip_force: constant (Fx, Fy) or (Fx, Fy, Mz) on the tip, world axes.
        loads: forces and moments anywhere on the simulated arm; no controller includes them in its
            model.
        base_acceleration: (ax, ay) of the base joint, m/s^2, a function of time that returns it, or
            a table ``(times, values)``; positions stay relative to the base.
        events: events to locate during the run (``Event``, ``joint_event``, ``tip_event``). The
            search compares samples, so two crossings within ``1 / rate`` may be missed. A terminal
            event ends the run and is its last sample.
        contacts: surfaces for contact with points of the arm, fixed relative to the base.
        changes: numbers of the simulated arm that change during the run (``Change``); the
            controller's model does not. Samples and readings at the time of a change are before it,
            also at the start; only a terminal event in its jump records the state after it.
        settings: the arguments that follow as one object, see ``flexarm.RunSettings``.
        integrator: "auto", a name of ``flexarm.integrate.INTEGRATORS``, or an integrator object.
        rate: samples recorded per second, Hz; the last one may lie before the end of the run.
        stations: sections of each link, evenly spaced from root to tip, at which to record axial
            force, shear force and bending moment; 0 for none.
        step: fixed step, or first step of a method with step control, s; an integrator object has
            its own. If the step is too long for "rk4", "auto" uses another method and warns. A
            fixed-step method without a step halves it until the tip differs by at most 1e-4 of
            the reach from the motion at twice the step.
        accuracy: largest error of the tip (m) that the integration may cause, such as 1e-5 of the
            reach, the hundredth part of a line in a plot. Method and tolerances follow from it, a
            second run verifies it, and a run that misses it is repeated; a smooth arm begins with
            large tolerances. Only the position of the tip counts. Instead of ``rtol`` and ``atol``.
            Without these, ``step`` and a named integrator, the accuracy is 1e-5 of the reach; then
            a smooth arm begins with large tolerances, too, and a second run verifies motions in
            which errors may grow: small tolerances follow if the error is larger.
        rtol, atol: error allowed per step, relative, by default 1e-7 where no accuracy decides, and
            absolute in metres at the tip, by default ``rtol / 100`` of the reach; with a fixed step
            only the tolerance for functions of time. A run whose whole motion is small beside
            ``atol`` is repeated with a smaller one. A run in which joints meet their stops is
            repeated with tolerances smaller by 1e-5, or more if the error requires it, and one that
            returns to a surface if it requires it. Runs with a controller are not repeated.
        torque_interpolation: "cubic", "linear" or "hold", for a torque array. The cubic overshoots
            samples that jump; the other two never exceed them.
        breaks: times (s) at which a function of time (torque, factor of a load, base acceleration,
            prescribed motion) jumps or has a kink, in addition to its own ``breaks``. Needed for
            features shorter than the attribute ``shortest_feature``. They also split the cubic of
            ``torque`` samples, which is linear between the samples before and after a break.
        specialized: True compiles the hot loop for the sizes of this arm (several seconds, once per
            size and machine; a third faster); None does so in the middle of a long run.
        progress: True or False shows or hides the progress bar of long runs; None shows it on a
            terminal.

    Returns:
        Dataset over ``time`` with the channels of ``flexarm.simulation.run.channels``; with
        ``events`` also ``event_time`` (s), ``event_name``, ``event_direction`` (1 rising, -1
        falling), ``event_q`` and ``event_qd`` over ``event``. The attribute ``ended_by`` is
        "duration", "failure" or the name of the event that ended the run. The attribute
        ``accuracy`` (m) is absent if tolerances decide. If a second run verified large tolerances,
        the attribute ``integration_error`` (m, at the tip) is its estimated error. With ``changes``
        also ``change_time`` (s), ``change_path``, ``change_from``, ``change_to`` and
        ``change_energy`` (J, of the arm) over ``change``; the attribute ``arm`` describes the arm
        at the start.

    Raises:
        InputError: if an argument has the wrong shape, is not finite, or contradicts another, the
            initial state is deep inside a surface, a reference presses away from one, or the run
            would take hours, or far longer than with another integrator. An integrator object is
            not refused.
        SimulationError: if the run stops early, or a function of time raises an exception;
            ``.time`` is the time, ``.result`` the result up to then.

    Warns:
        LargeDeflectionWarning: if a link exceeds the linear beam theory.
        AccuracyWarning: if a fixed step is too long for vibrations or friction, or impacts on joint
            stops or surfaces amplify errors to more than 1e-5 of the reach and ten times ``rtol``,
            or with a fixed step to 1e-3 of the reach, or a given ``atol`` would have caused errors
            of 1 % of the motion. Runs with a controller and a fixed step are not checked; see the
            attribute ``impact_steps``. Also if the integration error exceeds ``accuracy``, or 3e-5
            of the reach by default, or if a linear law keeps the sag of the links at rest.
        UnstableLoopWarning: if the sampled loop is unstable at the start or the end of the motion,
            at a posture that it passes, or after a change of the arm, with growth by a factor of
            ten or more within the run. The attribute ``loop_growth`` (1/s) is the largest one;
            ``slow_instability`` describes smaller growth, or is empty.
        LimitWarning: if the error of a joint grows by much while its motor is at its limit, an
            instrument is at its limit for a tenth of its frames, or a joint stop or a contact is
            implausibly deep.
        ImplausibleValueWarning: if initial angles look like degrees, times like milliseconds,
            ``rate`` like a time, or limits of motors like those in another unit.
        FlexarmWarning: if a `PrescribedPerformance` leaves its bound.
    """
    return simulated(situation_of(simulate, arm, duration, settings, arguments))


def simulated(situation: Situation) -> xr.Dataset:
    """Return the result of a run with its warnings, as `simulate` does.

    Functions of time are approximated before a run begins. If one fails, the run is repeated up to
    the last time at which it returned a value, and the exception gets that result.
    """
    try:
        return _warned(situation)
    except FunctionError as failed:
        if failed.result is None and failed.time > 0.0:
            end = failed.time
            _keep_result(failed, lambda: simulated(replace(situation, duration=end)))
        raise


def _warned(situation: Situation) -> xr.Dataset:
    """Execute a run, report its warnings, and return its result."""
    arm, initial = situation.simulated, situation.initial
    controller, reference, hardware = situation.controller, situation.reference, situation.hardware
    begin = arm.unpadded(situation.start[0])
    angles = None if initial is None else begin[arm.joint_index][turning_joints(arm)]
    driven = angles, controller, reference, hardware
    warn_of(implausible_run(arm, situation.duration, situation.settings.rate, *driven))
    accuracy, doubt = situation.settings.accuracy, ""
    with Meter("simulating", situation.settings.progress) as meter:
        if accuracy is None:
            result, notices = _executed(meter, situation)
        else:
            (result, notices), doubt = _verified(meter, situation, accuracy)
    if doubt:
        notices = [*notices, (doubt, AccuracyWarning)]
        result.attrs["warning"] = " ".join(text for text, _ in notices)
    for text, category in notices:
        warn_caller(text, category)
    if left := exceeded_bound(result.attrs):
        warn_caller(left, FlexarmWarning)
    return result


def _executed(meter: Meter, situation: Situation) -> _Outcome:
    """Execute a run; return its result and its warnings."""
    run = situation.new_run(meter)
    controller = situation.controller
    if controller is None:
        result = _open_loop(run, situation.history_of(run), situation.interpolation)
        return result, run.notices
    simulated = situation.simulated
    acting = controller, situation.reference, situation.hardware
    loop = ClosedLoop(run, *acting)
    q = simulated.unpadded(situation.start[0])
    around = situation.contacts, q, situation.duration
    analysed = AnalysedLoop(situation.arm, simulated, *acting, *around)
    return _closed_loop(run, loop, partial(stability, analysed, {})), run.notices


def _verified(meter: Meter, situation: Situation, accuracy: float) -> tuple[_Outcome, str]:
    """Execute a run with an accuracy that a second run verifies; return it and a warning.

    The run of a smooth arm verifies itself, unless its errors grow.
    """
    first = _executed(meter, situation)
    if "integration_error" in first[0].attrs:
        return first, ""
    return with_error(first, accuracy, partial(_executed_again, meter, situation))


def _executed_again(
    meter: Meter, situation: Situation, accuracy: float, **how: Any
) -> _Outcome | None:
    """Execute a run with another accuracy and settings, without warnings; None if that fails."""
    arm = situation.simulated
    how["accuracy"] = accuracy
    if coarse_tolerance(situation.settings, arm) is not None:  # large ones have failed
        how |= {"accuracy": None, "rtol": tolerance_of_request(accuracy / reach_of(arm))}
    try:
        varied = replace(
            situation,
            settings=replaced(situation.settings, **how),
            controller=copy.deepcopy(situation.controller),  # the user's one keeps its state
        )
        with without_warnings(Warning):
            return _executed(meter, varied)
    except (FlexarmError, TypeError):
        return None


def _open_loop(
    run: Run, history_of: Callable[[float], PiecewiseCubic], interpolation: str
) -> xr.Dataset:
    started = time.perf_counter()
    failure: SimulationError | None = None
    try:
        run_accurately(run, history_of)
    except SimulationError as error:
        if run.history is None:  # a function of time failed before the run began
            raise
        failure = error
    assert run.history is not None
    result = _result(run, run.history, started, interpolation, str(failure or ""))
    if failure is not None:
        failure.result = result
        raise failure
    return result


def _closed_loop(run: Run, loop: ClosedLoop, analysis: Callable[..., Stability]) -> xr.Dataset:
    """Execute a run with a controller."""
    unstable, growth, slow, _ = analysis()
    if unstable and run.changes is None:
        warn_caller(unstable, UnstableLoopWarning)
    started = time.perf_counter()
    compare = loop_comparison(run, loop.repetition)
    failure: SimulationError | None = None
    try:
        loop.execute()
    except SimulationError as error:
        failure = error
    if run.changes is not None:  # the times of changes at events are known now
        unstable, growth, slow, _ = analysis(changed=run.changed_arms())
        if unstable:
            warn_caller(unstable, UnstableLoopWarning)
    if failure is None:
        compare()
        result = _result(run, loop, started, "hold", "", unstable)
        return add_loop(result, loop, growth).assign_attrs(slow_instability=slow)
    # A bound that does not hold, or an instability, is the cause of every later failure.
    causes = filter(None, [exceeded_bound(loop.report()), unstable])
    failure.hint = " ".join(f"{text[0].upper()}{text[1:]}" for text in causes) or failure.hint
    if loop.times:
        result = _result(run, loop, started, "hold", str(failure), unstable)
        failure.result = add_loop(result, loop, growth)
    raise failure


def _result(
    run: Run,
    drive: PiecewiseCubic | ClosedLoop,
    started: float,
    interpolation: str,
    failure: str = "",
    unstable: str = "",
) -> xr.Dataset:
    count = run.progress.sample
    times = run.sample_times[:count]
    integrator, progress = run.integrator, run.progress
    log = run.watch.log if run.watch is not None else None
    ended_by = FAILURE if failure else (log and log.ended_by) or DURATION
    reason = run.choice.reason + (run.default_step.reason() if run.default_step else "")
    law = ["HuntCrossley1975"] if run.loads.placed.contacts.body.size else []
    request, reach = run.request, reach_of(run.first_arm)
    features = run.loads.factors.shortest_feature, getattr(drive, "shortest_feature", 0.0)
    attributes: dict[str, Any] = {
        **({} if request is None else {"accuracy": request * reach}),
        **({} if run.error is None else {"integration_error": run.error * reach}),
        "integrator": integrator.name,
        "integrator_reason": reason,
        "rtol": run.tolerance.relative,
        "atol": run.tolerance.absolute * run.tolerance.scale,
        "steps": progress.steps,
        "rejected_steps": progress.rejected,
        "impact_steps": progress.impacts,
        "torque_interpolation": interpolation,
        "evaluations": progress.evaluations + run.discarded,
        "shortest_feature": max(features),
        "wall_seconds": time.perf_counter() - started,
        "references": " ".join([*integrator.reference, *law]),
        "failure": failure,
        "ended_by": ended_by,
        "unstable_loop": unstable,
    }
    loop = drive if isinstance(drive, ClosedLoop) else None
    given = drive.acting.at(times) if isinstance(drive, ClosedLoop) else drive.at(times)
    channels = channels_of_run(run, given)
    numbers, texts = limits_of_run(run, loop, channels)
    run.notices = notices_of(run, texts, failure)
    if loop is not None and not failure:
        kept = sag_warning(loop.controller, loop.reference, times, lambda: channels["tip"])
        run.notices += [(kept, AccuracyWarning)] if kept else []
    attributes["warning"] = " ".join(text for text, _ in run.notices)
    if loop is not None and log is None:  # otherwise add_loop appends it
        channels["torque_command"] = loop.command_at(times)
    result = make_result(run.first_arm, times, channels, attributes)
    result = add_limits(
        result, run.first_arm, numbers, loop.instruments if loop is not None else ()
    )
    if log is not None:
        result = result.assign(event_variables(run.first_arm, log))
    return result if run.changes is None else result.assign(change_variables(run.changes))


#: Accuracy of the second run over that of the first.
_LOOSER = 10.0
#: Accuracy of the first run over that of another one, if both have the same steps.
_FINER = 1000.0
#: Integrator of the second run, if both have the same steps.
_OTHERS = {"dormand_prince_8": "kennedy_carpenter_5"}
#: Runs until a requested accuracy counts as missed; aim of a repetition over the request, and the
#: least accuracy of a repetition over the one before.
_MOST_RUNS, _AIM, _LEAST_ACCURACY = 4, 0.3, 1e-3


def with_error(
    outcome: _Outcome, accuracy: float, executed: Callable[..., _Outcome | None]
) -> tuple[_Outcome, str]:
    """Return a run whose result has the attribute ``integration_error`` (m), and a warning.

    If the error exceeds the accuracy, the run is repeated with a smaller one. The warning is empty
    if a run reaches the accuracy. ``evaluations`` and ``wall_seconds`` are those of all runs.
    """
    attributes = outcome[0].attrs
    method, steps = attributes["integrator"], attributes["steps"]
    if method in _OTHERS and are_alike(steps, attributes.get("controller_calls", 0)):
        # Tolerances do not matter for steps that end at the samples, the method does.
        runs, error = [outcome], math.nan
        for part in (1.0, _FINER):
            other = executed(accuracy / part, integrator=_OTHERS[method])
            if other is None:
                break
            runs, error = [other, *runs], _error_between(outcome, other, 1.0)
            if error <= accuracy:
                break
        if len(runs) > 1:
            return _judged(runs, accuracy, error)
    used, looser = accuracy, executed(_LOOSER * accuracy)
    runs = [outcome] if looser is None else [looser, outcome]
    error = _error_between(outcome, looser, _LOOSER)
    # The steps may be those of samples, or of the largest tolerance.
    if looser is not None and are_alike(steps, looser[0].attrs["steps"]):
        finer = executed(accuracy / _FINER)
        if finer is not None:
            runs, used = [*runs, finer], accuracy / _FINER
            error = _error_between(finer, outcome, _FINER)
    for _ in range(_MOST_RUNS - 2):
        if not error > accuracy:
            break
        ratio = 1.0 / max(_AIM * accuracy / error, _LEAST_ACCURACY)
        finer = executed(used / ratio)
        if finer is None or finer[0].attrs["rtol"] == runs[-1][0].attrs["rtol"]:
            break
        error = _error_between(finer, runs[-1], ratio)
        runs, used = [*runs, finer], used / ratio
    return _judged(runs, accuracy, error)


def _judged(runs: Sequence[_Outcome], accuracy: float, error: float) -> tuple[_Outcome, str]:
    """Return the last one of some runs with its error (m) and the work of all, and a warning."""
    names = "evaluations", "wall_seconds"
    work = {name: sum(result.attrs[name] for result, _ in runs) for name in names}
    result, notices = runs[-1]
    last = result.assign_attrs(accuracy=accuracy, integration_error=error, **work), notices
    if result.attrs["unstable_loop"]:
        text = "errors grow with the unstable loop"
    elif error <= accuracy:
        return last, ""
    elif math.isnan(error):
        text = "no other run can be compared with this one, so the integration error is unknown"
    else:
        text = f"errors grow in this motion: that of the tip is about {error:.1g} m"
    return last, f"{text}. Do not rely on an accuracy of {accuracy:.2g} m."


def _error_between(outcome: _Outcome, other: _Outcome | None, ratio: float) -> float:
    """Return the estimated error (m) of the tip in a result; NaN without another one."""
    if other is None:
        return math.nan
    results = outcome[0], other[0]
    finer, coarser = (result.attrs["rtol"] for result in results)
    if finer == coarser <= LEAST:  # rounding errors of both are equal
        return math.nan
    count = min(result.sizes["time"] for result in results)
    tips = (result.tip.values[:count, :2] for result in results)
    apart = float(np.abs(np.subtract(*tips)).max(initial=0.0))
    return apart * share_of_finer(ratio)
