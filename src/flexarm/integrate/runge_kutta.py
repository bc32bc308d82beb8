"""Explicit Runge-Kutta integrators: a tableau given to the compiled stepper."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.integrate.explicit import advance_explicit
from flexarm.integrate.steps import CLOCK_PLACES, IMPACTS, STEP, TIME
from flexarm.integrate.tableau import Tableau


@dataclass(frozen=True)
class ExplicitRungeKutta(Integrator):
    """Common part of the explicit methods.

    Args:
        step: fixed step (s) of a method without step control, or the first step to try; None lets
            ``simulate`` find a fixed one (``flexarm.engine.default_step``).
    """

    step: float | None = None

    #: Default step times the highest frequency.
    step_per_radian: ClassVar[float] = 0.5

    @property
    @abstractmethod
    def tableau(self) -> Tableau:
        """Coefficients of the method."""

    def advance(
        self,
        system: System,
        tolerance: Tolerance,
        progress: Progress,
        until: float,
        sample_times: FloatArray,
        samples: FloatArray,
        max_steps: int,
    ) -> Status:
        """See ``Integrator.advance``."""
        tableau = self.tableau
        memory = progress.memory
        if not memory:
            step = self.step or progress.step or self.step_per_radian / tolerance.fastest
            memory["clock"] = np.zeros(CLOCK_PLACES)
            memory["clock"][STEP] = step
            memory["counts"] = np.zeros(4, dtype=np.int64)
            memory["new"] = np.empty_like(progress.state)
            memory["torque"] = np.zeros(progress.state.shape[1])
            memory["stages"] = np.zeros((len(tableau.c), *progress.state.shape))
            memory["weights"] = np.zeros((1, len(tableau.c)))
        clock, counts = memory["clock"], memory["counts"]
        clock[TIME] = progress.time
        counts[0] = progress.sample
        status = progress.enter(
            advance_explicit,
            system,
            tolerance,
            tableau.A,
            tableau.c,
            tableau.error,
            tableau.error_low,
            tableau.dense,
            tableau.order,
            self.adaptive,
            progress.state,
            memory["new"],
            memory["torque"],
            memory["stages"],
            memory["weights"],
            clock,
            counts,
            float(until),
            sample_times,
            samples,
            max_steps,
        )
        progress.time, progress.step = float(clock[TIME]), float(clock[STEP])
        progress.impacts = int(clock[IMPACTS])
        progress.take(counts)
        return status
