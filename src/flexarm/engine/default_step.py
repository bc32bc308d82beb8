"""The step of a fixed-step method that was given none: halved until the motion agrees.

Two trials go through time side by side, with steps h and h / 2. Where they differ by more than is
allowed, the finer one becomes the coarser one of the next pair. Nothing is assumed about the arm:
joint stops, friction, contacts and the motion of rigid links count as much as vibrations do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance

if TYPE_CHECKING:
    from flexarm.engine.event_search import Mark
    from flexarm.engine.stepping import Run

#: How far two trials may differ over a run, as a part of the reach. The finer trial errs by less.
ALLOWED = 1e-4
#: First step of the coarser trial: radians of the fastest mode, and fewest steps in a run.
_RADIANS, _FEWEST = 1.0, 32
#: Loops and plants are compared at the end of each sample time, where a difference may be the part
#: of this that the sample time is of the run; a plant without a duration counts as so long (s).
_UNBOUNDED = 10.0
#: The rate of a joint counts there with the angle that it makes in this time (s).
_DRIFT = 1.0
#: Halvings that are tried in any case, and steps of a span up to which there may be more.
_HALVINGS, _MOST_STEPS = 6, 1e7
#: A trial checks another one only if it makes this many times its steps: both make the same steps
#: where stops of the torque are close together, or where a method shortens them for stability.
_FINER = 1.5
#: Failures of the arm, and not of the step, where both trials end with them.
_OF_THE_ARM = (Status.INERTIA_LOST, Status.PRESSED_THROUGH)


class _Start(NamedTuple):
    """Where the trials of a span begin."""

    time: float
    state: FloatArray  # (2, n, 1 + m)
    sample: int
    steps: int
    evaluations: int
    mark: Mark | None


@dataclass
class _Trial:
    """One of the two runs through a span, its samples, and how its last call ended."""

    progress: Progress
    times: FloatArray  # (samples,)
    samples: FloatArray  # (samples, 2, n, 1 + m)
    status: Status = Status.PAUSED

    def begin(self, start: _Start, step: float, anew: bool) -> None:
        """Go to the start of the span; ``anew``: with nothing remembered from before it."""
        progress = self.progress
        if anew or progress.step != step:
            progress.memory.clear()
        elif progress.memory:
            progress.memory["counts"][:] = 0
        progress.time, progress.step, progress.sample = start.time, step, start.sample
        progress.steps = progress.evaluations = 0  # of the trial
        progress.state[...] = start.state
        self.status = Status.PAUSED


@dataclass
class DefaultStep:
    """Carries a run from time to time with steps that it finds.

    Attributes:
        first: step (s) of the coarser trial to begin with.
        shortest: step (s) of the finer trial, the shortest that was used.
        difference: largest difference (m at the tip) of two trials that agreed.
    """

    first: float
    shortest: float = math.inf
    difference: float = 0.0
    _step: float = math.inf  # of the coarser trial in the span before, s
    _coarse: Progress | None = field(default=None, repr=False)

    def reason(self) -> str:
        """What a result adds to the reason for its integrator; nothing before a span is done."""
        if not math.isfinite(self.shortest):
            return ""
        return (
            f"; step {self.shortest:.3g} s, at which the motion differs by {self.difference:.1g} m "
            "from that at twice the step"
        )

    def carry(self, run: Run, system: System, until: float) -> System:
        """Advance the run to ``until`` (s); return the system to go on with.

        Raises:
            SimulationError: no step was found, or the arm cannot be followed with any.
        """
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
        self.difference = max(self.difference, pair.difference)
        self._coarse = pair.coarse.progress
        if halvings > 0:
            self._step = step
        elif pair.difference < pair.allowed * 0.5 ** (run.integrator.order + 2):
            self._step = 2.0 * max(self._step, step)
        return system

    def _search(
        self, pair: _Pair, run: Run, system: System, start: _Start, until: float
    ) -> tuple[System, int]:
        """Halve the steps until the trials agree; return the system, and how often it was done."""
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
    """Return what finds the step of a run, or None where a step is given or controlled."""
    given = integrator.adaptive or getattr(integrator, "step", None) is not None
    return None if given else DefaultStep(_RADIANS / tolerance.fastest)


@dataclass
class _Pair:
    """Two trials of a span, and whether they agree to its end."""

    coarse: _Trial
    fine: _Trial
    whole: bool  # the span is the run: its samples are compared, else its end and the rates there
    unit: FloatArray  # (levels, n, 1 + m) coordinates, and rates, per metre at the tip
    allowed: float  # m at the tip
    difference: float = 0.0
    agreed: bool = False

    @classmethod
    def of(cls, run: Run, start: _Start, until: float) -> _Pair:
        """Make the pair of a span; its trials have still to begin."""
        whole = start.time == 0.0 and until >= run.duration
        unit = run.tolerance.unit
        allowed = ALLOWED / float(unit[0, :, 0].min())
        fine = _Trial(run.progress, run.sample_times, run.samples)
        if whole:
            coarse = replace(fine, samples=np.empty_like(run.samples))
            return cls(coarse, fine, whole, unit[:1], allowed)
        unit = unit.copy()
        unit[1, :, 0] = np.minimum(unit[1, :, 0], unit[0, :, 0] / _DRIFT)
        allowed *= (until - start.time) / min(run.duration, _UNBOUNDED)
        coarse = _Trial(run.progress, run.sample_times[:0], run.samples[:0])
        return cls(coarse, fine, whole, unit, allowed)

    def follow(self, run: Run, system: System, until: float) -> System:
        """Advance the trial that is behind, until they differ, fail, or are through."""
        coarse, fine = self.coarse, self.fine
        self.difference, compared = 0.0, 0
        while Status.PAUSED in (coarse.status, fine.status):
            behind = coarse.progress.time <= fine.progress.time or fine.status != Status.PAUSED
            trial = coarse if coarse.status == Status.PAUSED and behind else fine
            system, trial.status = run.advance(
                system, trial.progress, until, trial.times, trial.samples
            )
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
        """Compare states (k, 2, n, 1 + m)."""
        apart = np.abs(coarse - fine)[:, : len(self.unit)] / self.unit
        self.difference = max(self.difference, float(apart.max(initial=0.0)))
        return self.difference <= self.allowed and bool(np.isfinite(apart).all())

    def _finer(self) -> bool:
        return self.fine.progress.steps >= _FINER * self.coarse.progress.steps

    def refuse(self, run: Run, enough: bool) -> None:
        """Raise where shorter steps do not help, or ``enough`` of them were tried.

        Raises:
            SimulationError: the arm cannot be followed, or no step was found.
        """
        status = self.fine.status
        if status == self.coarse.status and status in _OF_THE_ARM:
            raise run.failure(status)
        if not enough:
            return
        step = self.fine.progress.step
        reason = (
            f"no step was given, and at one of {step:.2g} s the motion still changes by "
            f"{self.difference:.2g} m when the step is halved."
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
        if not self.whole:  # one of them alone fills the samples of the run
            old, new = self.coarse, self.fine
            old.times, new.times = new.times, old.times
            old.samples, new.samples = new.samples, old.samples
