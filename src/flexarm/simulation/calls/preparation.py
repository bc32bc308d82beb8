"""Preparation of runs: validated options, initial state, torque over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions.environment import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.stations import MOST_STATIONS
from flexarm.base.arguments import (
    check_choice,
    check_count,
    check_flag,
    check_function,
    check_positive,
    check_tolerance,
)
from flexarm.base.errors import InputError, Problem, check_array, shown
from flexarm.base.user_functions import call
from flexarm.control.contract.base import Reference
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.model import Change
from flexarm.model.scenarios.scenario import sample_fault
from flexarm.simulation.histories.functions import function_history
from flexarm.simulation.histories.loads import LoadHistory, load_history
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.histories.prescribed import Prescribed, prescribe
from flexarm.simulation.histories.samples import INTERPOLATIONS, sampled_torque
from flexarm.simulation.run.events import EventLog
from flexarm.simulation.run.new_run import initial_state, new_run
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.stepping import Run

Torque = ArrayLike | Callable[[float], ArrayLike] | PiecewiseCubic


class RunOptions(NamedTuple):
    """Validated options of a run, with the meaning that ``simulate`` gives them."""

    duration: float  # s
    rate: float  # Hz
    step: float | None  # s
    rtol: float
    atol: float | None  # m; None for the default
    breaks: FloatArray  # (k,) s
    interpolation: str  # of torque samples
    integrator: str | Integrator
    stations: int
    specialized: bool | None

    @property
    def times(self) -> FloatArray:
        """Sample times (samples,), s."""
        count = int(np.floor(self.duration * self.rate * (1 + 1e-12))) + 1
        # The last sample may exceed the end by rounding, and would then never be computed.
        return np.minimum(np.arange(count) / self.rate, self.duration)

    def loads_of(
        self,
        arm: Arm,
        environment: Environment,
        known: dict[tuple[int, ...], PiecewiseCubic],
    ) -> LoadHistory:
        """Return the loads of a run without contacts; see ``load_history``."""
        given = self.duration, self.rtol, None, self.breaks, 1.0 / self.rate
        return load_history(arm, environment, *given, known)

    def new_run(
        self,
        arm: Arm,
        state: FloatArray,
        environment: Environment,
        log: EventLog | None,
        meter: Meter,
        changes: Sequence[Change] = (),
        prescribed: Prescribed | None = None,
    ) -> Run:
        """Create a run from ``state`` (2, n, 1 + m); the errors are those of ``new_run``."""
        return new_run(
            arm,
            state,
            duration=self.duration,
            sample_times=self.times,
            environment=environment,
            breaks=self.breaks,
            spacing=1.0 / self.rate,
            log=log,
            integrator=self.integrator,
            step=self.step,
            rtol=self.rtol,
            atol=self.atol,
            meter=meter,
            stations=self.stations,
            specialized=self.specialized,
            changes=changes,
            prescribed=tuple(prescribed or ()),
        )


def run_options(
    duration: float,
    *,
    rate: float,
    step: float | None,
    rtol: float,
    atol: float | None,
    breaks: ArrayLike,
    torque_interpolation: str,
    integrator: str | Integrator,
    stations: int,
    specialized: bool | None,
) -> RunOptions:
    """Validate the options of a run; the integrator is validated when the run is created.

    Raises:
        InputError: if an option has the wrong type or value.
    """
    if specialized is not None:
        check_flag("specialized", specialized)
    duration = check_positive("duration", duration)
    if step is not None and check_positive("step", step) > duration:
        rule = f"be at most the duration of {duration:.6g} s"
        raise InputError(Problem("step", rule, shown(step)))
    rate = check_positive("rate", rate)
    known = check_array("breaks", breaks, (-1,))
    check_choice("torque_interpolation", torque_interpolation, INTERPOLATIONS)
    rtol = check_tolerance("rtol", rtol)
    atol = None if atol is None else check_positive("atol", atol)
    if (fault := sample_fault(duration, rate)) is not None:
        raise InputError(fault.problem())
    stations = check_count("stations", stations, 0, MOST_STATIONS)
    if stations == 1:
        raise InputError(Problem("stations", "be 0, or at least 2 (root and tip)", "1"))
    return RunOptions(
        duration, rate, step, rtol, atol, known, torque_interpolation, integrator, stations,
        specialized,
    )  # fmt: skip


def start_of(
    arm: Arm,
    initial: ArrayLike | None,
    initial_rate: ArrayLike | None,
    reference: Reference | None,
    torque: Torque | None,
) -> FloatArray:
    """Return the initial state (2, n, 1 + m), by default at the start of the motion.

    Raises:
        InputError: if coordinates, rates or the motion do not fit the arm.
    """
    motion = reference if reference is not None else getattr(torque, "motion", None)
    straight = np.zeros(arm.joints)
    if initial is None and motion is not None:
        name = "reference" if reference is not None else "torque"
        straight = np.asarray(call(name, motion.joint_angle, 0.0))
        if straight.shape != (arm.joints,):
            rule = f"have the number of joints of the arm ({arm.joints})"
            raise InputError(Problem(name, rule, str(straight.size)))
    return initial_state(arm, initial, initial_rate, straight)


def between_samples(torque: Torque | None, options: RunOptions) -> str:
    """Return the interpolation of samples of a torque; that of a function of time is "cubic"."""
    return "cubic" if torque is None or callable(torque) else options.interpolation


def torque_history(
    arm: Arm,
    torque: Torque | None,
    prescribed: Prescribed,
    state: FloatArray,
    options: RunOptions,
    relative: float,
) -> PiecewiseCubic:
    """Return torques and prescribed accelerations for a relative tolerance of the run.

    The start of prescribed joints is set in ``state``.

    Raises:
        InputError: if torques or prescribed motions do not fit the arm.
        FunctionError: if a function of time raises an exception.
    """
    joints, duration, breaks = arm.joints, options.duration, options.breaks
    spacing = 1.0 / options.rate
    if torque is None:
        history = PiecewiseCubic.constant(np.zeros(joints))
    elif isinstance(torque, PiecewiseCubic):
        history = torque.held_to(duration)
    elif callable(torque):
        check_function("torque", torque)
        history = function_history(torque, duration, joints, relative, breaks, spacing=spacing)
    else:
        history = sampled_torque(
            torque, options.rate, duration, joints, options.interpolation, breaks
        )
    return prescribe(arm, prescribed, state, history, duration, relative, breaks, spacing)
