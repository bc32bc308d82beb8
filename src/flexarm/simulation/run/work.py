"""Work of a run before it starts: choice of "auto" by a trial, and refusal of hopeless runs.

An explicit method must follow the fastest vibration for the whole run: its work is the duration
times a frequency. An implicit method follows what is visible at the tolerances: its work is
estimated from some of its steps at the start of the run. Work is counted in evaluations of the
dynamics, and not in time, because time depends on the load of the machine.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.integrate import Integrator, KennedyCarpenter5
from flexarm.integrate.base import FloatArray, Progress, Status, System, Tolerance
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.integrator_choice import (
    Choice,
    choose_by_drive,
    explicit_work,
    settling,
)
from flexarm.simulation.run.stepping import Run, system_of
from flexarm.simulation.run.tolerance import RTOL, scale_over_reach

#: Explicit work above which a trial is made. Below, a run takes some milliseconds, and a second
#: method would have to be compiled.
_WORTH_A_TRIAL = 5_000.0
#: Steps of the first round of a trial; the part of the explicit work, and the evaluations, that all
#: rounds may take. Steps lengthen while vibrations decay, so that a shorter trial overestimates the
#: work: of 20 stiff random arms, three then took five to eleven times the work of the other method.
_FIRST_ROUND, _SHARE, _LONGEST_TRIAL = 12, 0.2, 2e5
#: The implicit method is chosen if its work is less than this part of the explicit work: at equal
#: tolerances its error is a hundred times as large, at equal error it takes 2.5 times as much.
_CHEAPER = 1.0 / 3.0
#: A trial ends early if its estimate exceeds the explicit work by this factor: the first steps
#: overestimate the work by up to 20, because vibrations have not decayed yet.
_DEARER = 5.0
#: Steps after which a vibration that the implicit method does not resolve has decayed are
#: ``_DECAY * visible ** _POWER`` for an amplitude of ``visible`` times the allowed error. Fitted to
#: links of EI = 1e3 to 1e8 N m^2 that gravity sets into motion; ``visible`` is 40 to 4e4.
_DECAY, _POWER = 6.0, 0.85
#: Amplitude, as a multiple of the relative tolerance times the reach, above which a vibration is
#: motion that must be followed.
_SEEN = 100.0
#: Evaluations of a step of the implicit method.
EVALUATIONS_A_STEP = 9.0
#: Phase (rad) of the fastest vibration in a sample time above which "auto" is implicit in a loop.
#: In 24 stable loops of random arms with a phase of 8 to 40, the implicit method takes 0.50 times
#: the evaluations of the explicit one (median; at most 0.82) at the default tolerance, and errs by
#: 4e-6 of the reach at most. Below, it sometimes takes 1.8 times as many, or errs by 6e-5. At
#: smaller tolerances its steps shorten as tolerance^(1/5). The second number holds where friction,
#: backlash, stops, contacts or changes of the arm may amplify its errors, and is the largest one.
_SAMPLED, _SAMPLED_ROUGH = 8.0, 60.0
#: Work, in evaluations times coordinates, at which a run is refused: hours of computing; or, if
#: another method takes less than a hundredth, a minute.
_HOPELESS, _LONG, _BETTER = 1e11, 5e8, 0.01


class Start(NamedTuple):
    """Initial state of a run, and what determines its work."""

    arm: Arm
    state: FloatArray  # (2, n, 1 + m)
    tolerance: Tolerance
    duration: float  # s
    system: Callable[[], System]  # creates one for a trial, with loads of its own


def choose_by_work(choice: Choice, start: Start, open_end: bool = False) -> Choice:
    """Return the integrator of an open-loop run; "auto" takes the one with the least work."""
    if choice.insisted:
        return choice
    explicit = explicit_work(choice.fastest, start.duration)
    size = start.state[0].size
    implicit = np.inf
    switch = choice.open and not isinstance(choice.integrator, KennedyCarpenter5)
    if explicit > _WORTH_A_TRIAL and (switch or explicit * size > _LONG):
        implicit = implicit_work(start, explicit)
    if switch and implicit < _CHEAPER * explicit:
        reason = (
            "order 5 with bending implicit: the fastest vibrations would take an explicit method "
            f"about {explicit:.0e} evaluations and need not be followed at the tolerances in use"
        )
        choice = choice._replace(integrator=_implicit(start), reason=reason)
    work = _work_of(choice.integrator, start.duration, explicit, implicit)
    if not open_end:
        _refuse(choice.integrator, work, implicit, start.duration, size)
    return choice._replace(work=work)


def choose_by_samples(
    choice: Choice,
    arm: Arm,
    sample_time: float,
    duration: float,
    tolerance: Tolerance,
    rough: bool = False,
) -> Choice:
    """Return the integrator of a sampled loop, whose torques are not known in advance."""
    if choice.insisted:
        return choice
    pushing = ((one.friction, one.limits, one.backlash) for one in arm.spec.joints)
    rough = rough or any(own or stops or slack > 0.0 for own, stops, slack in pushing)
    limit = _SAMPLED * max(1.0, (RTOL / tolerance.relative) ** 0.2)
    phase = choice.fastest * sample_time
    if choice.open and phase > (_SAMPLED_ROUGH if rough else min(limit, _SAMPLED_ROUGH)):
        reason = (
            f"order 5 with bending implicit: the fastest vibration turns by {phase:.3g} rad in a "
            "sample time and need not be followed"
        )
        choice = choice._replace(integrator=KennedyCarpenter5(), reason=reason)
    if np.isfinite(duration):
        implicit = EVALUATIONS_A_STEP * duration / sample_time
        explicit = explicit_work(choice.fastest, duration)
        work = _work_of(choice.integrator, duration, explicit, implicit)
        modes = arm.assembly.constants.mode[:, :, 0].size
        _refuse(choice.integrator, work, implicit, duration, modes)
    return choice


def _implicit(start: Start) -> Integrator:
    return settling(KennedyCarpenter5(), start.arm, start.tolerance)


def implicit_work(start: Start, explicit: float) -> float:
    """Estimate the evaluations of "kennedy_carpenter_5" over a run; infinite if its trial fails.

    The trial ends as soon as the estimate differs clearly from the work of an explicit method.
    """
    system, method = start.system(), _implicit(start)
    progress = Progress(0.0, start.state.copy(), 0.0)
    samples = np.zeros(0), np.zeros((0, *start.state.shape))
    steps = _FIRST_ROUND
    while True:
        time, evaluations = progress.time, progress.evaluations
        status = method.advance(system, start.tolerance, progress, start.duration, *samples, steps)
        if status == Status.DONE:
            return float(progress.evaluations)
        if status != Status.PAUSED or not progress.time > time:
            return np.inf
        rate = (progress.evaluations - evaluations) / (progress.time - time)
        ahead = rate * (start.duration - progress.time)
        work = progress.evaluations + min(ahead, EVALUATIONS_A_STEP * _decay(start, progress.state))
        decided = work < _CHEAPER * explicit or work > _DEARER * explicit
        if decided or progress.evaluations > min(_SHARE * explicit, _LONGEST_TRIAL):
            return work
        steps *= 2


def _decay(start: Start, state: FloatArray) -> float:
    """Return the steps after which vibrations have decayed; infinite if they must be followed."""
    tolerance = start.tolerance
    absolute, relative, unit = tolerance.absolute, tolerance.relative, tolerance.unit
    size = (np.abs(state) / unit)[:, :, 1:].max(initial=0.0)
    reach = 1.0 / scale_over_reach(start.arm.assembly.constants, unit)
    if size > _SEEN * (absolute + relative * reach):
        return np.inf
    return float(_DECAY * (size / (absolute + relative * size)) ** _POWER)


def _work_of(integrator: Integrator, duration: float, explicit: float, implicit: float) -> float:
    """Return the evaluations of a method; at most, if the implicit method was not tried."""
    if isinstance(integrator, KennedyCarpenter5):
        return min(implicit, explicit)  # at equal tolerances it is hardly ever more expensive
    if integrator.adaptive or integrator.step is None:
        return explicit
    return duration / integrator.step


def _refuse(
    integrator: Integrator, work: float, implicit: float, duration: float, size: int
) -> None:
    """Raise if a run is hopeless."""
    better = implicit < _BETTER * work and (integrator.adaptive or integrator.step is None)
    if work * size <= (_LONG if better else _HOPELESS):
        return
    kind = type(integrator).__name__
    rule = (
        f"{integrator.name} would take about {work:.0e} evaluations of the dynamics for "
        f"{duration:.6g} s"
    )
    remedy = "Reduce the duration (is it in seconds?), elements or modes"
    if better:
        name = KennedyCarpenter5.name
        remedy = f"Use integrator='auto' or {name!r}, which takes about {implicit:.0e}"
    hint = f"{remedy}, or pass the object flexarm.integrate.{kind}() to run it all the same."
    raise InputError(Problem("integrator", rule, hint=hint))


@dataclass
class Checkpoints:
    """Step control of a run at some of its samples; the states are those of the samples.

    Attributes:
        places: (k,) of the samples, ascending, without the first and the last one.
        clocks: ``Memory.clock`` at each of them; empty if the step is searched for the whole run.
    """

    places: NDArray[np.intp]
    clocks: list[FloatArray] = field(default_factory=list)

    @classmethod
    def among(cls, samples: int) -> Checkpoints:
        """Return checkpoints whose number and distances are the square root of that of samples."""
        apart = max(1, math.isqrt(samples))
        return cls(np.arange(apart, samples - 1, apart))

    def carry(self, run: Run, system: System) -> System:
        """Advance a run to the last checkpoint; return the system for the next call."""
        self.clocks.clear()
        if run.default_step is None:
            for time in run.sample_times[self.places]:
                system = run.carry_to(system, float(time))
                assert run.progress.memory is not None
                self.clocks.append(run.progress.memory.clock.copy())
        return system


def choose(run: Run, history: PiecewiseCubic) -> None:
    """Choose the integrator of a run under a given torque history, and set ``run.history``."""
    run.history = history
    changed = run.changes.times if run.changes is not None else np.zeros(0)
    stops = np.concatenate([run.loads.stops_with(history), changed])
    choice = choose_by_drive(run.choice, run.arm, stops, run.duration)
    system = partial(system_of, run.arm, run.prescribed, run.loads, history)
    start = Start(run.arm, run.progress.state, run.tolerance, run.duration, system)
    ends = run.watch is not None and any(event.terminal for event in run.watch.log.events)
    choice = choose_by_work(choice, start, open_end=ends or run.changes is not None)
    if choice is not run.choice:
        run.adopt(choice)
        run.doubt = choice.doubt


def run_open_loop(
    run: Run, history: PiecewiseCubic, checkpoints: Checkpoints | None = None
) -> None:
    """Simulate a run under a given torque history, and fill ``checkpoints``."""
    choose(run, history)
    system = run.system(history)
    if checkpoints is not None:
        system = checkpoints.carry(run, system)
    run.carry_to(system, run.duration)
