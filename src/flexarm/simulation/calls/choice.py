"""Integrator that ``simulate`` would use, without a run."""

from __future__ import annotations

from collections.abc import Mapping
from inspect import signature
from typing import Any

from flexarm.arm.actions.environment import Environment
from flexarm.arm.arm import Arm
from flexarm.integrate import Integrator
from flexarm.simulation.calls.preparation import run_options, start_of, torque_history
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.loop.sampled_loop import SampleSchedule
from flexarm.simulation.run.events import event_log
from flexarm.simulation.run.integrator_choice import Choice
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.work.open_loop import choose

_OPTIONS = (
    *("rate", "rtol", "atol", "breaks", "torque_interpolation", "stations", "specialized"),
    *("initial", "initial_rate", "reference", "torque", "prescribed", "events", "changes"),
    *("tip_force", "loads", "base_acceleration", "contacts", "controller", "hardware", "plant"),
)


def integrator_of(
    arm: Arm,
    duration: float,
    integrator: str | Integrator,
    step: float | None,
    arguments: Mapping[str, Any],
) -> Choice:
    """Return the integrator of a run, by the rules of ``simulate``.

    Args:
        arguments: the other arguments of ``simulate``.

    Raises:
        InputError: if ``simulate`` would raise it.
    """
    defaults = signature(simulate).parameters
    given = {name: arguments.get(name, defaults[name].default) for name in _OPTIONS}
    options = run_options(
        duration,
        integrator=integrator,
        step=step,
        **{name: given[name] for name in _OPTIONS[:7]},
    )
    simulated = given["plant"] or arm
    torque, controller, prescribed = given["torque"], given["controller"], given["prescribed"]
    state = start_of(simulated, given["initial"], given["initial_rate"], given["reference"], torque)
    acting = (given[name] for name in ("tip_force", "loads", "base_acceleration", "contacts"))
    environment, log = Environment.of(simulated, *acting), event_log(simulated, given["events"])
    meter = Meter("checking", False)
    run = options.new_run(simulated, state, environment, log, meter, given["changes"], prescribed)
    if controller is not None:
        return SampleSchedule(run, controller.sample_time, given["hardware"]).run.choice
    choose(run, torque_history(simulated, torque, prescribed or {}, state, options, options.rtol))
    return run.choice
