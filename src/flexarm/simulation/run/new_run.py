"""Creation of a run: initial state, tolerances, integrator and placed loads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, check_array
from flexarm.integrate.base import FloatArray, Progress
from flexarm.model import Change
from flexarm.simulation.histories.loads import LoadHistory, load_history
from flexarm.simulation.run.changes import arm_changes
from flexarm.simulation.run.contacts import contact_frequency, contacts_of_run
from flexarm.simulation.run.default_step import default_step
from flexarm.simulation.run.event_search import Watch
from flexarm.simulation.run.events import EventLog
from flexarm.simulation.run.integrator_choice import choose_integrator
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import (
    RunSettings,
    relative_tolerance,
    request_of,
    tolerances_of,
)
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import for_arm, tolerance_of

#: Number of sample times that stand for the duration of a plant without one.
UNBOUNDED = 1e4


def new_run(
    arm: Arm,
    state: FloatArray,
    settings: RunSettings,
    *,
    duration: float,
    sample_times: FloatArray,
    spacing: float,
    environment: Environment,
    meter: Meter,
    log: EventLog | None = None,
    changes: Sequence[Change] = (),
    prescribed: tuple[int, ...] = (),
) -> Run:
    """Create a run at its initial state ``state`` (2, n, 1 + m).

    The arguments are those of ``simulate``. They are validated by the caller, except for the
    environment. ``spacing`` is the interval (s) between the instants at which functions of time are
    compared with their cubic approximations.

    Raises:
        InputError: if a load, the base acceleration, a contact or a change does not fit the arm, or
            the integrator does not support it.
    """
    touching = contacts_of_run(arm, environment.contacts, state)
    touch = contact_frequency(arm, touching)
    horizon = UNBOUNDED * spacing if math.isinf(duration) else duration
    request = request_of(settings, arm)
    tolerance = tolerance_of(arm, state, *tolerances_of(settings, arm), horizon)
    choice = choose_integrator(
        settings.integrator, settings.step, arm, tolerance, touch, prescribed, horizon
    )
    tolerance = tolerance._replace(fastest=max(tolerance.fastest, touch))

    def loads_of(relative: float) -> LoadHistory:
        given = duration, relative, touching, settings.breaks, spacing
        return load_history(arm, environment, *given)

    return Run(
        arm=arm,
        choice=choice,
        integrator=choice.integrator,
        tolerance=tolerance,
        progress=Progress(0.0, state, 0.0),
        duration=duration,
        horizon=horizon,
        sample_times=sample_times,
        samples=np.empty((len(sample_times), *state.shape)),
        loads=loads_of(relative_tolerance(settings, arm)),
        loads_of=loads_of,
        meter=meter,
        prescribed=prescribed,
        stations=settings.stations,
        specialized=settings.specialized,
        default_atol=settings.atol is None,
        request=request,
        promised=settings.accuracy is not None,
        watch=Watch(arm, choice.integrator, tolerance, log) if log else None,
        default_step=default_step(choice.integrator, tolerance),
        changes=arm_changes(arm, changes, duration, log),
        environment=environment,
        doubt=choice.doubt,
    )


def restarted(run: Run, state: FloatArray, settings: RunSettings) -> Run:
    """Return a run like one without contacts and events, from another initial state.

    The new run shares arm, loads and sample times with ``run``.

    Args:
        state: (2, n, 1 + m).
        settings: those of ``run``.
    """
    tolerance = for_arm(run.tolerance, run.arm, state, run.horizon)
    requested = settings.integrator, settings.step
    choice = choose_integrator(*requested, run.arm, tolerance, 0.0, run.prescribed, run.horizon)
    return replace(
        run,
        choice=choice,
        integrator=choice.integrator,
        tolerance=tolerance,
        progress=Progress(0.0, state, 0.0),
        samples=np.empty((len(run.sample_times), *state.shape)),
        default_step=default_step(choice.integrator, tolerance),
    )


def initial_state(
    arm: Arm, q: ArrayLike | None, qd: ArrayLike | None, straight: FloatArray
) -> FloatArray:
    """Return the state (2, n, 1 + m) for coordinates and rates (dof,).

    Without ``q`` the links are straight at the joint angles ``straight`` (joints,); without ``qd``
    the rates are zero.

    Raises:
        InputError: if the coordinates or rates do not have shape (dof,).
    """
    if q is None:
        q = arm.rest(straight)
    given = check_array("initial", q, (-1,))
    if given.size != arm.dof:
        hint = "Arm.rest(joint_angles) gives the coordinates of straight links."
        rule = f"have shape ({arm.dof},) for the coordinates of the arm"
        raise InputError(Problem("initial", rule, f"shape {given.shape}", hint))
    rates = np.zeros(arm.dof) if qd is None else check_array("initial_rate", qd, (-1,))
    if rates.size != arm.dof:
        hint = "Arm.rest(joint_rates) gives the rates of straight links."
        rule = f"have shape ({arm.dof},) for the rates of the coordinates"
        raise InputError(Problem("initial_rate", rule, f"shape {rates.shape}", hint))
    return arm.padded(np.stack([given, rates]))
