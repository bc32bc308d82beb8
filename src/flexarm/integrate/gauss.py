"""Gauss collocation of order 6: symmetric, keeps the energy of long motions without damping."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from flexarm.integrate.additive import SOFTENED
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.integrate.collocation import advance_collocation
from flexarm.integrate.kennedy_carpenter import named
from flexarm.integrate.steps import SPAN_PLACES, TIME
from flexarm.kernels.implicit_step import constants_to_soften

#: Change of a sweep, as a part of the state, that ends the iteration: a twentieth of a unit in the
#: last place. What is left then is much the same in each step, so in a million steps it adds up.
_ROUNDING = 0.05 * float(np.finfo(float).eps)


class Coefficients(NamedTuple):
    """Coefficients of Gauss collocation with s stages, for second-order equations."""

    A: FloatArray  # (s, s)
    AA: FloatArray  # (s, s) A A
    b: FloatArray  # (s,)
    bA: FloatArray  # (s,) b A
    c: FloatArray  # (s,)
    guess: FloatArray  # (2, s, 2 s) weights of earlier stages in a first guess


def gauss_coefficients(stages: int) -> Coefficients:
    """Coefficients from the quadrature of Gauss and Legendre; Hairer and Wanner II, IV.5."""
    x, w = np.polynomial.legendre.leggauss(stages)
    c, b = (1.0 + x) / 2.0, w / 2.0
    powers = np.arange(stages)
    A = (c[:, None] ** (powers + 1) / (powers + 1)) @ np.linalg.inv(c[:, None] ** powers)
    guess = np.zeros((2, stages, 2 * stages))
    guess[0, :, stages:] = _continued(c - 1.0, c)
    guess[1] = _continued(np.concatenate([c - 2.0, c - 1.0]), c)
    return Coefficients(A, A @ A, b, b @ A, c, guess)


def _continued(known: FloatArray, asked: FloatArray) -> FloatArray:
    """Weights (asked, known) of the polynomial through values at ``known``."""
    powers = np.arange(known.size)
    return np.asarray(asked[:, None] ** powers @ np.linalg.inv(known[:, None] ** powers))


_COEFFICIENTS = gauss_coefficients(3)
#: What h^2 K and h D are multiplied by on the diagonal of a sweep: such that linear vibrations
#: converge fastest at the step where they do so most slowly, (I.15).
_PULL, _DRAG = 0.0337, 0.214


@dataclass(frozen=True)
class Gauss6(Integrator):
    """Order 6, three stages, fixed step, symmetric: the energy of long runs does not drift.

    Bending, springs and damping are implicit; the stages are solved to rounding. A step must be
    short enough for that: about what an explicit method of high order takes.

    Args:
        step: fixed step (s), shortened to meet every stop; None lets ``simulate`` find one
            (``flexarm.engine.default_step``).
    """

    step: float | None = None

    name = "gauss_6"
    order = 6
    follows_contacts = False
    reference = ("HairerLubichWanner2006", "HouwenSwart1997")

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
        coefficients = _COEFFICIENTS
        memory = progress.memory
        shape = progress.state.shape
        if not memory:
            count = len(coefficients.c)
            memory["clock"] = np.zeros(SOFTENED + 1)
            memory["span"] = np.zeros(SPAN_PLACES)
            memory["counts"] = np.zeros(4, dtype=np.int64)
            for name in ("new", "inner", "lost"):
                memory[name] = np.zeros(shape)
            memory["stages"] = np.zeros((count, *shape[1:]))
            memory["earlier"] = np.zeros((2 * count, *shape[1:]))
            memory["ends"] = np.zeros((2, *shape))
            for name in ("added", "force"):
                memory[name] = np.zeros(shape[1:])
            memory["torque"] = np.zeros(shape[1])
            memory["change"] = np.zeros((1, *shape))
            memory["one"] = np.ones(1)
            own = constants_to_soften(system.constants)
            memory |= {f"softened.{name}": array for name, array in own._asdict().items()}
        clock, counts = memory["clock"], memory["counts"]
        clock[TIME] = progress.time
        counts[0] = progress.sample
        step = float(self.step or progress.step or 0.5 / tolerance.fastest)
        reach = 1.0 / float(tolerance.unit[0, :, 0].min())
        status = progress.enter(
            advance_collocation,
            system,
            named("softened", memory),
            tolerance,
            tolerance._replace(absolute=_ROUNDING * reach, relative=_ROUNDING),
            coefficients.A,
            coefficients.AA,
            coefficients.b,
            coefficients.bA,
            coefficients.c,
            _PULL,
            _DRAG,
            coefficients.guess,
            progress.state,
            memory["new"],
            memory["inner"],
            memory["lost"],
            memory["stages"],
            memory["earlier"],
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
