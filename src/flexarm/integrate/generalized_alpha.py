"""The generalised-alpha method: order 2, with chosen damping of what the step does not resolve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.errors import InputError, Problem, check_array, shown
from flexarm.integrate.additive import SOFTENED
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.integrate.kennedy_carpenter import named
from flexarm.integrate.newmark import advance_newmark
from flexarm.integrate.steps import SPAN_PLACES, TIME
from flexarm.kernels.implicit_step import constants_to_soften

#: A step is solved no closer than this, relative to the state: rounding stands in the way.
_ROUNDING = 1e-12


@dataclass(frozen=True)
class GeneralizedAlpha(Integrator):
    """Order 2, fixed step, chosen damping of fast vibrations; bending implicit, no limit of step.

    The tolerances say how closely the equations of a step are solved, not how far the step errs.

    Args:
        step: fixed step (s), shortened to meet every stop; None lets ``simulate`` find one
            (``flexarm.engine.default_step``).
        spectral_radius: factor per step on a vibration far too fast for the step: 1 keeps it, 0
            removes it at once.

    Raises:
        InputError: the spectral radius is not a number from 0 to 1.
    """

    step: float | None = None
    spectral_radius: float = 0.8

    name = "generalized_alpha"
    order = 2
    follows_contacts = False
    reference = ("ChungHulbert1993", "ArnoldBruels2007")

    def __post_init__(self) -> None:
        where, name = "GeneralizedAlpha", "spectral_radius"
        radius = float(check_array(where, name, self.spectral_radius, ()))
        if not 0.0 <= radius <= 1.0:
            raise InputError(Problem(where, name, "be between 0 and 1", shown(radius)))

    @property
    def rule(self) -> FloatArray:
        """Coefficients alpha_m, alpha_f, beta, gamma, (I.10)."""
        radius = float(self.spectral_radius)
        alpha_m = (2.0 * radius - 1.0) / (radius + 1.0)
        alpha_f = radius / (radius + 1.0)
        return np.array([alpha_m, alpha_f, (radius + 1.0) ** -2, 0.5 + alpha_f - alpha_m])

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
        memory = progress.memory
        shape = progress.state.shape
        if not memory:
            memory["clock"] = np.zeros(SOFTENED + 1)
            memory["span"] = np.zeros(SPAN_PLACES)
            memory["counts"] = np.zeros(4, dtype=np.int64)
            memory["rule"] = self.rule
            for name in ("smooth", "known"):
                memory[name] = np.zeros(shape)
            for name in ("averaged", "added", "force"):
                memory[name] = np.zeros(shape[1:])
            memory["torque"] = np.zeros(shape[1])
            memory["ends"] = np.zeros((2, *shape))
            memory["change"] = np.zeros((1, *shape))
            memory["one"] = np.ones(1)
            own = constants_to_soften(system.constants)
            memory |= {f"softened.{name}": array for name, array in own._asdict().items()}
        clock, counts = memory["clock"], memory["counts"]
        clock[TIME] = progress.time
        counts[0] = progress.sample
        step = float(self.step or progress.step or 0.5 / tolerance.fastest)
        status = progress.enter(
            advance_newmark,
            system,
            named("softened", memory),
            tolerance._replace(
                absolute=max(tolerance.absolute, _ROUNDING),
                relative=max(tolerance.relative, _ROUNDING),
            ),
            memory["rule"],
            progress.state,
            memory["smooth"],
            memory["known"],
            memory["averaged"],
            memory["ends"],
            memory["added"],
            memory["force"],
            memory["torque"],
            memory["change"],
            memory["one"],
            clock,
            memory["span"],
            counts,
            step,
            float(until),
            sample_times,
            samples,
            max_steps,
        )
        progress.time, progress.step = float(clock[TIME]), step
        progress.take(counts)
        return status
