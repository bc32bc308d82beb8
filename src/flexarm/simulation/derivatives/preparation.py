"""The run that is differentiated, and the checks of arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from inspect import signature
from typing import Any

import numpy as np

from flexarm.arm.actions.environment import Environment
from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem, nearest, suggestion
from flexarm.kernels.compilation.packs import COMPILED
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.simulation.calls.preparation import RunOptions, start_of, torque_history
from flexarm.simulation.calls.run import check_objects, simulate
from flexarm.simulation.derivatives.inputs import inputs_of_run
from flexarm.simulation.derivatives.parameters import Parameters, Samples
from flexarm.simulation.derivatives.recorded_loop import RecordedLoop
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.contact_start import refuse_deep_start, refuse_pressing_outward
from flexarm.simulation.run.events import event_log
from flexarm.simulation.run.impacts import run_to_slips, stopping_at_breaks
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.small_motion import run_accurately
from flexarm.simulation.run.work.open_loop import Checkpoints

#: Channels that follow from q and qd alone.
_OF_STATES = (
    *("joint_angle", "joint_rate", "joint_twist", "link_angle", "link_rate"),
    *("link_tip_deflection", "link_tip_slope", "link_tip_deflection_rate", "link_tip_slope_rate"),
    *("tip", "tip_velocity", "tip_angle", "tip_angle_rate"),
    *("kinetic_energy", "strain_energy", "gravity_energy", "strain", "q", "qd"),
)


def simulated(
    arm: Arm,
    options: RunOptions,
    given: Mapping[str, Any],
    by_samples: bool,
    meter: Meter,
    checkpoints: Checkpoints | None = None,
    *,
    once: bool = False,
) -> Parameters:
    """Simulate a run; return what its derivatives require.

    Args:
        given: arguments of ``simulate`` that are not options.
        by_samples: whether steps end at every torque sample. A step that spans several samples
            computes their derivatives inaccurately.
        checkpoints: filled by a run without a controller.
        once: whether the run has exactly these tolerances, and is not repeated with others.

    Raises:
        InputError: if an argument does not fit the arm.
        SimulationError: if the run stops early, or a function of time raises an exception.
    """
    torque, prescribed = given["torque"], given.get("prescribed")
    controller, reference = given.get("controller"), given.get("reference")
    hardware = given.get("hardware")
    check_objects(arm, None, controller, reference, hardware, torque, prescribed)
    if not COMPILED:
        raise InputError(Problem("NUMBA_DISABLE_JIT", "is not supported with derivatives of runs"))
    state = start_of(arm, given["initial"], given["initial_rate"], reference, torque)
    names = "tip_force", "loads", "base_acceleration", "contacts"
    environment = Environment.of(arm, *(given[name] for name in names))
    log = event_log(arm, given.get("events", ()))
    if log is not None:
        refuse_bristles(arm, "events", hint="Their times have no derivatives then.")
    run = options.new_run(arm, state, environment, log, meter, prescribed=prescribed)
    placed = run.loads.placed.contacts
    refuse_deep_start(arm, state, placed)
    tips = int(given["tip_force"] is not None)
    if controller is not None:
        refuse_pressing_outward(arm, given["contacts"], placed, reference, options.duration)
        loop = RecordedLoop(run, controller, reference, hardware, channels_of_states(arm))
        loop.execute()
        run.history = loop.history
        return Parameters(run, environment, inputs_of_run(run, environment), None, tips, loop)
    history_of = partial(torque_history, arm, torque, prescribed or {}, state, options)
    torque_of = partial(stopping_at_breaks, history_of) if by_samples else history_of
    (run_to_slips if once else run_accurately)(run, torque_of, checkpoints)
    return Parameters(
        run,
        environment,
        inputs_of_run(run, environment),
        _samples(torque, history_of, options),
        tips,
        checkpoints=checkpoints,
    )


def _samples(
    torque: Any, history_of: Callable[[float], PiecewiseCubic], options: RunOptions
) -> Samples | None:
    """Return torque samples; None for another kind of torque."""
    if torque is None or callable(torque) or isinstance(torque, PiecewiseCubic):
        return None
    samples, joints = np.shape(torque)
    history = history_of(options.rtol)
    return Samples(history, (samples, joints), options.rate, options.interpolation)


def refuse_unsupported(given: Mapping[str, Any]) -> None:
    """Reject arguments of ``simulate`` that derivatives do not support, and unknown ones.

    Raises:
        InputError: if there is any; all are listed.
    """
    known = signature(simulate).parameters
    problems = [
        Problem(name, "is not supported with derivatives of runs")
        if name in known
        else Problem(name, "is not an argument", hint=nearest(name, known))
        for name in given
    ]
    if problems:
        raise InputError(*problems)


def channels_of_states(arm: Arm) -> list[str]:
    """Return the names of the channels of an arm that follow from q and qd."""
    return [name for name in _OF_STATES if name != "strain" or arm.gauges]


def check_channels(arm: Arm, argument: str, given: Sequence[str] | None) -> list[str]:
    """Return the names of channels; None: of all that are possible.

    Raises:
        InputError: if a channel does not exist or does not follow from q and qd.
    """
    possible = channels_of_states(arm)
    if given is None:
        return possible
    names = check_list_of(argument, given, str)
    known = f"Known: {', '.join(possible)}."
    problems = [
        Problem(
            f"{argument}[{k}]",
            "be a channel that follows from q and qd",
            repr(name),
            # No similar name if the channel exists: it is not a spelling error.
            known if name in CHANNELS else suggestion(name, possible),
        )
        for k, name in enumerate(names)
        if name not in possible
    ]
    if problems:
        raise InputError(*problems)
    return names
