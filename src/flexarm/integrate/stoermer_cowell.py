"""Cowell's two-step method of order 4 for long vibrations: symmetric, one evaluation a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from flexarm.integrate.additive import SOFTENED
from flexarm.integrate.base import FloatArray, Integrator, Progress, Status, System, Tolerance
from flexarm.integrate.cowell import advance_cowell
from flexarm.integrate.kennedy_carpenter import KennedyCarpenter4, named
from flexarm.integrate.steps import SPAN_PLACES, TIME
from flexarm.kernels.implicit_step import constants_to_soften


@dataclass(frozen=True)
class Cowell4(Integrator):
    """Order 4, fixed step, one evaluation a step, neither gain nor loss of vibration energy.

    Energy is kept of small vibrations; the predicted velocity products of large ones cost a little.
    It does not follow contacts: the formula looks back over four points of a smooth motion.
    Bending and damping are implicit, and damped modes too fast for the step are carried on by the
    trapezoidal rule. After every stop, where the torque is not smooth, three steps are made by
    ``kennedy_carpenter_4``. A motion too fast for the predictions ends it.

    Args:
        step: longest step (s), shortened to meet every stop, and to what the highest frequency and
            the fastest damping of the arm, bent or straight, ask for; None lets ``simulate``
            find one (``flexarm.engine.default_step``).
    """

    step: float | None = None

    name = "cowell_4"
    order = 4
    follows_contacts = False
    reference = ("HairerNorsettWanner1993", "KennedyCarpenter2003")

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
        tableau = KennedyCarpenter4.tableau
        memory = progress.memory
        shape = progress.state.shape
        if not memory:
            memory["clock"] = np.zeros(SOFTENED + 1)
            memory["span"] = np.zeros(SPAN_PLACES)
            memory["missed"] = np.zeros(3)
            memory["bounds"] = np.zeros(5)
            memory["counts"] = np.zeros(4, dtype=np.int64)
            memory["past"] = np.zeros((4, 3, *shape[1:]))
            for name in ("smooth", "known"):
                memory[name] = np.zeros(shape)
            for name in ("added", "force", "rise", "stiff"):
                memory[name] = np.zeros(shape[1:])
            memory["torque"] = np.zeros(shape[1])
            memory["stages"] = np.zeros((len(tableau.c), *shape))
            for place in ("softened", "starter"):
                own = constants_to_soften(system.constants)
                memory |= {f"{place}.{name}": array for name, array in own._asdict().items()}
        clock, counts = memory["clock"], memory["counts"]
        clock[TIME] = progress.time
        counts[0] = progress.sample
        step = float(self.step or progress.step or 0.5 / tolerance.fastest)
        status = progress.enter(
            advance_cowell,
            system,
            named("softened", memory),
            named("starter", memory),
            tolerance,
            tableau.explicit,
            tableau.implicit,
            tableau.c,
            progress.state,
            memory["smooth"],
            memory["known"],
            memory["past"],
            memory["rise"],
            memory["stiff"],
            memory["added"],
            memory["force"],
            memory["torque"],
            memory["stages"],
            clock,
            memory["span"],
            memory["missed"],
            memory["bounds"],
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
