"""Step-size search for fixed-step methods without a given step, by halving until convergence.

Two trials advance side by side with steps h and h / 2. If they differ by more than the allowed
difference, the finer trial becomes the coarser one of the next pair. The search makes no
assumption about the arm: joint stops, friction, contacts and the motion of rigid links count as
much as vibrations do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.simulation.run.tolerance import scale_over_reach

if TYPE_CHECKING:
    from flexarm.simulation.run.events import Mark
    from flexarm.simulation.run.stepping import Run

#: Allowed difference of two trials over a run, as a fraction of the reach. The error of the finer
#: trial is smaller.
ALLOWED = 1e-4
#: First step of the coarser trial: phase of the fastest mode (rad), and minimum number of steps.
_RADIANS, _FEWEST = 1.0, 32
#: Closed loops and plants are compared at the end of each sample time. The allowed difference is
#: proportional to the sample time over the duration. The rate of a joint counts in this comparison
#: as the angle that it covers in this fraction of the duration.
_DRIFT = 0.1
#: Minimum number of halvings, and number of steps in a span above which the search then stops.
_HALVINGS, _MOST_STEPS = 6, 1e7
#: A trial verifies another one only if it makes this many times its steps. Both make the same steps
#: if torque breaks are close together, or if a method shortens its steps for stability.
_FINER = 1.5
#: Failures caused by the arm and not by the step, if both trials end with the same one.
_OF_THE_ARM = (Status.INERTIA_LOST, Status.PRESSED_THROUGH)


class _Start(NamedTuple):
    """Initial values of the trials of a span."""

    time: float
    state: FloatArray  # (2, n, 1 + m)
    sample: int
    steps: int
    evaluations: int
    mark: Mark | None


@dataclass
class _Trial:
    """One of the two trials of a span: its progress, its samples and its last status."""

    progress: Progress
    times: FloatArray  # (samples,)
    samples: FloatArray  # (samples, 2, n, 1 + m)
    status: Status = Status.PAUSED

    def begin(self, start: _Start, step: float, anew: bool) -> None:
        """Return to the start of the span; ``anew`` clears the memory of multistep methods."""
        progress = self.progress
        if anew or progress.step != step:
            progress.memory = None
        progress.time, progress.step, progress.sample = start.time, step, start.sample
        progress.steps = progress.evaluations = 0  # of the trial
        progress.state[...] = start.state
        self.status = Status.PAUSED


@dataclass
class DefaultStep:
    """Step-size search that advances a run from one time to the next.

    Attributes:
        first: initial step (s) of the coarser trial.
        shortest: shortest step (s) of a finer trial that was accepted.
        difference: largest difference (m at the tip) of two trials that agreed.
        scale: ``Tolerance.scale`` (m).
    """

    first: float
    shortest: float = math.inf
    difference: float = 0.0
    scale: float = 1.0
    _step: float = math.inf  # of the coarser trial in the span before, s
    _coarse: Progress | None = field(default=None, repr=False)

    def reason(self) -> str:
        """Return the text to append to the reason for the integrator; empty before any span."""
        if not math.isfinite(self.shortest):
            return ""
        return (
            f"; step {self.shortest:.3g} s, at which the motion differs by {self.difference:.1g} m "
            "from that at twice the step"
        )

    def carry(self, run: Run, system: System, until: float) -> System:
        """Advance the run to ``until`` (s) and return the system for the next call."""
        begun = run.progress
        mark = run.watch.mark() if run.watch is not None else None
        counts = begun.sample, begun.steps, begun.evaluations
        start = _Start(begun.time, begun.state.copy(), *counts, mark)
        span = until - start.time
        pair = _Pair.of(run, start, until)
        step = min(self._step, self.first, span)
        if pair.whole:
            pieces = max(system.drive.breaks.size, system.drive.factor_breaks.size) - 1
            step = min(step, span / max(_FEWEST, pieces))
        pair.coarse.progress = self._coarse or Progress(0.0, begun.state.copy(), 0.0)
        pair.coarse.begin(start, step, anew=False)
        pair.fine.begin(start, 0.5 * step, anew=False)
        try:
            system, halvings = self._search(pair, run, system, start, until)
        finally:
            run.progress.steps += start.steps
            run.progress.evaluations += start.evaluations
        step = pair.coarse.progress.step
        self.shortest = min(self.shortest, 0.5 * step)
        self.difference = max(self.difference, pair.difference * self.scale)
        self._coarse = pair.coarse.progress
        if halvings > 0:
            self._step = step
        elif pair.difference < pair.allowed * 0.5 ** (run.integrator.order + 2):
            self._step = 2.0 * max(self._step, step)
        return system

    def _search(
        self, pair: _Pair, run: Run, system: System, start: _Start, until: float
    ) -> tuple[System, int]:
        """Halve the steps until the trials agree; return the system and the number of halvings."""
        halvings = 0
        while True:
            system = pair.follow(run, system, until)
            coarse = pair.coarse.progress
            run.discarded += coarse.evaluations
            if pair.agreed:
                return system, halvings
            many = until - start.time > _MOST_STEPS * coarse.step
            pair.refuse(run, enough=many and halvings >= _HALVINGS)
            halvings += 1
            pair.swap()
            pair.fine.begin(start, 0.5 * pair.coarse.progress.step, anew=True)
            run.progress, run.samples = pair.fine.progress, pair.fine.samples
            if run.watch is not None and start.mark is not None:
                run.watch.restore(start.mark)


def default_step(integrator: Integrator, tolerance: Tolerance) -> DefaultStep | None:
    """Return the step-size search of a run, or None if the step is given or adaptive."""
    given = integrator.adaptive or getattr(integrator, "step", None) is not None
    return None if given else DefaultStep(_RADIANS / tolerance.fastest, scale=tolerance.scale)


@dataclass
class _Pair:
    """Two trials of a span and the state of their comparison."""

    coarse: _Trial
    fine: _Trial
    whole: bool  # the span is the entire run: compare its samples, otherwise its final state
    unit: FloatArray  # (levels, n, 1 + m) of ``Tolerance``: coordinates, and rates
    allowed: float  # over ``Tolerance.scale``, at the tip
    difference: float = 0.0
    agreed: bool = False

    @classmethod
    def of(cls, run: Run, start: _Start, until: float) -> _Pair:
        """Create the pair of a span; the caller then starts both trials."""
        whole = start.time == 0.0 and until >= run.duration
        unit = run.tolerance.unit
        allowed = ALLOWED / scale_over_reach(run.arm.assembly.constants, unit)
        fine = _Trial(run.progress, run.sample_times, run.samples)
        if whole:
            coarse = replace(fine, samples=run.samples.copy())
            return cls(coarse, fine, whole, unit[:1], allowed)
        unit = unit.copy()
        unit[1, :, 0] = np.minimum(unit[1, :, 0], unit[0, :, 0] / (_DRIFT * run.horizon))
        allowed *= (until - start.time) / run.horizon
        coarse = _Trial(run.progress, run.sample_times[:0], run.samples[:0])
        return cls(coarse, fine, whole, unit, allowed)

    def follow(self, run: Run, system: System, until: float) -> System:
        """Advance the trial that is behind until the two differ, fail or reach ``until``."""
        coarse, fine = self.coarse, self.fine
        self.difference, compared = 0.0, 0
        while Status.PAUSED in (coarse.status, fine.status):
            behind = coarse.progress.time <= fine.progress.time or fine.status != Status.PAUSED
            trial = coarse if coarse.status == Status.PAUSED and behind else fine
            target = until, trial.times, trial.samples
            system, trial.status = run.advance(system, trial.progress, *target)
            if trial.status not in (Status.DONE, Status.PAUSED, *_OF_THE_ARM):
                return system
            if not self.whole:
                continue
            ready = min(coarse.progress.sample, fine.progress.sample)
            if not self._near(coarse.samples[compared:ready], fine.samples[compared:ready]):
                return system
            compared = max(compared, ready)
            passed = coarse.progress.time >= fine.progress.time and self._finer()
            if passed and fine.status == Status.PAUSED and run.ended_by_event(system, fine.status):
                self.agreed = True
                return system
        if coarse.status == fine.status == Status.DONE:
            ends = coarse.progress.state[None], fine.progress.state[None]
            self.agreed = self._near(*ends) and self._finer()
        if self.agreed:
            run.ended_by_event(system, Status.DONE)
        return system

    def _near(self, coarse: FloatArray, fine: FloatArray) -> bool:
        """Compare states (k, 2, n, 1 + m) with the allowed difference."""
        apart = np.abs(coarse - fine)[:, : len(self.unit)] / self.unit
        self.difference = max(self.difference, float(apart.max(initial=0.0)))
        return self.difference <= self.allowed and bool(np.isfinite(apart).all())

    def _finer(self) -> bool:
        return self.fine.progress.steps >= _FINER * self.coarse.progress.steps

    def refuse(self, run: Run, enough: bool) -> None:
        """Raise if shorter steps do not help, or if ``enough`` of them were tried."""
        status = self.fine.status
        if status == self.coarse.status and status in _OF_THE_ARM:
            raise run.failure(status)
        if not enough:
            return
        step = self.fine.progress.step
        reason = (
            f"no step was given, and at one of {step:.2g} s the motion still changes by "
            f"{self.difference * run.tolerance.scale:.2g} m when the step is halved."
        )
        for trial in (self.coarse, self.fine):
            if trial.status not in (Status.PAUSED, Status.DONE):
                reason = (
                    f"no step was given, and one of {step:.2g} s fails: {trial.status.sentence}"
                )
        hint = "Use integrator='auto', whose steps follow the error, or give a step."
        raise run.failure(status, reason, hint)

    def swap(self) -> None:
        """Make the finer trial the coarser one of the next pair."""
        self.coarse, self.fine = self.fine, self.coarse
        if not self.whole:  # only the finer trial fills the samples of the run
            old, new = self.coarse, self.fine
            old.times, new.times = new.times, old.times
            old.samples, new.samples = new.samples, old.samples
