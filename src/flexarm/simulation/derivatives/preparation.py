"""The run that is differentiated, and the checks of arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from inspect import signature
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem, nearest, suggestion
from flexarm.kernels.compilation.packs import COMPILED
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.simulation.calls.preparation import Situation
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.derivatives.inputs import inputs_of_run
from flexarm.simulation.derivatives.loop_in_duals import RecordedLoop
from flexarm.simulation.derivatives.parameters import Parameters, Samples
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings, settings_of
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
    situation: Situation, by_samples: bool, meter: Meter, checkpoints: Checkpoints | None = None
) -> Parameters:
    """Simulate a run; return what its derivatives require.

    Args:
        by_samples: whether steps end at every torque sample. A step that spans several samples
            computes their derivatives inaccurately.
        checkpoints: filled by a run without a controller.

    Raises:
        InputError: if an argument does not fit the arm.
        SimulationError: if the run stops early, or a function of time raises an exception.
    """
    if not COMPILED:
        raise InputError(Problem("NUMBA_DISABLE_JIT", "is not supported with derivatives of runs"))
    arm, environment = situation.arm, situation.environment
    if situation.events:
        refuse_bristles(arm, "events", hint="Their times have no derivatives then.")
    run = situation.new_run(meter)
    tips = int(situation.tip_force is not None)
    if situation.controller is not None:
        loop = RecordedLoop(
            run,
            situation.controller,
            situation.reference,
            situation.hardware,
            channels_of_states(arm),
        )
        loop.execute()
        run.history = loop.history
        return Parameters(run, environment, inputs_of_run(run, environment), None, tips, loop)
    history_of = situation.history_of(run)
    torque_of = partial(_with_stops, history_of) if by_samples else history_of
    run_accurately(run, torque_of, checkpoints)
    return Parameters(
        run,
        environment,
        inputs_of_run(run, environment),
        _samples(situation, history_of),
        tips,
        checkpoints=checkpoints,
    )


def _samples(situation: Situation, history_of: Callable[[float], PiecewiseCubic]) -> Samples | None:
    """Return torque samples; None for another kind of torque."""
    torque, settings = situation.torque, situation.settings
    if torque is None or callable(torque) or isinstance(torque, PiecewiseCubic):
        return None
    samples, joints = np.shape(torque)
    history = history_of(settings.relative(situation.simulated))
    return Samples(history, (samples, joints), settings.rate, settings.torque_interpolation)


def _with_stops(history_of: Callable[[float], PiecewiseCubic], relative: float) -> PiecewiseCubic:
    """Return a history in which steps end at every break.

    A step that spans several torque samples computes their derivatives inaccurately.
    """
    history = history_of(relative)
    return replace(history, stops=np.unique(history.breaks[history.breaks > 0.0]))


def settings_of_run(
    settings: RunSettings | None, keywords: Mapping[str, Any], function: Callable[..., Any]
) -> RunSettings:
    """Return the settings of a run that is differentiated; see `settings_of`.

    Raises:
        InputError: if there are arguments of ``simulate`` that derivatives do not support, or
            unknown ones; all are listed.
    """
    known = signature(simulate).parameters
    problems = [
        Problem(name, "is not supported with derivatives of runs")
        if name in known
        else Problem(name, "is not an argument", hint=nearest(name, known))
        for name in keywords.keys() - vars(function)["settings"]
    ]
    if problems:
        raise InputError(*problems)
    return settings_of(settings, keywords, function)


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
