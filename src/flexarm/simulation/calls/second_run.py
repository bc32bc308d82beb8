"""Error of the derivatives of a run through contacts, joint stops and friction that holds.

The error control of the steps knows the motion alone. Each impact multiplies the errors of the
derivatives before it, and each start or end of sticking adds the derivative of its time, so such a
run is differentiated twice. Without one, the derivatives are as accurate as the motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexarm.arm.observe import contact_values
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.kernels.columns import LOWER_STOP, STOP_STIFFNESS, UPPER_STOP
from flexarm.kernels.forces.contact import GAP
from flexarm.simulation.run.impacts import slides
from flexarm.simulation.run.settings import RunSettings, replaced
from flexarm.simulation.run.stepping import Run

#: Ratio of both tolerances, also for joints that slide against friction that holds, and the least
#: relative tolerance that rounding errors allow. Each time at which a joint sticks or slips has the
#: error of a step: derivatives of two sliding joints have 6e-6 at a ratio of 0.01, and 1e-7 here.
_RATIO, _SLIDING, _LEAST = 0.01, 1e-4, 1e-13
#: Difference of both runs above which derivatives get a warning: at a hundredth of the tolerances,
#: and with half the step, where the error of the result is about the difference.
_DOUBTFUL, _DOUBTFUL_STEP = 1e-2, 1e-3


class SecondRun(NamedTuple):
    """Settings of a second run."""

    settings: RunSettings
    tighter: bool  # whether it is the more accurate one
    allowed: float  # largest difference without a warning

    def doubt(self, error: float) -> str:
        """Return a warning for an estimated relative error; empty if it is small."""
        if error <= self.allowed:
            return ""
        return (
            f"the derivatives have an estimated relative error of {error:.1g}, because contacts, "
            "joint stops or friction amplify errors. Reduce rtol and atol, step or the duration."
        )


def second_run(run: Run, settings: RunSettings) -> SecondRun | None:
    """Return the settings of a second run; None if ``run`` met no contact, no stop and no friction.

    The second run is not repeated with other tolerances, so that these are the ones in use.
    """
    integrator, progress, used = run.integrator, run.progress, run.tolerance
    met = progress.impacts + progress.touches > 0 if integrator.adaptive else _touches(run)
    if not (met or slides(run)):
        return None
    if not integrator.adaptive:
        return SecondRun(_with_half_the_step(run, settings), True, _DOUBTFUL_STEP)
    tighter = used.relative * _RATIO >= _LEAST
    ratio = _RATIO if tighter else 1.0 / _RATIO
    if slides(run) and used.relative * _SLIDING >= _LEAST:
        ratio = _SLIDING
    second = replaced(settings, rtol=ratio * used.relative, atol=ratio * used.absolute * used.scale)
    return SecondRun(second, tighter, _DOUBTFUL)


def _touches(run: Run) -> bool:
    """Return whether a contact or a stop is compressed at a sample."""
    arm, states = run.arm, run.samples[: run.progress.sample]
    placed, body = run.loads.placed.contacts, run.arm.assembly.constants.body
    if placed.body.size and np.any(contact_values(arm, placed, states)[..., GAP] < 0.0):
        return True
    stopped = body[:, STOP_STIFFNESS] > 0.0
    angles, body = states[:, 0, stopped, 0], body[stopped]
    return bool(np.any((angles < body[:, LOWER_STOP]) | (angles > body[:, UPPER_STOP])))


def _with_half_the_step(run: Run, settings: RunSettings) -> RunSettings:
    search = run.default_step
    half = 0.5 * float((run.integrator.step if search is None else search.shortest) or 0.0)
    if isinstance(settings.integrator, Integrator):
        return replaced(settings, integrator=replace(settings.integrator, step=half))
    return replaced(settings, step=half)


def state_errors(run: Run, slopes: FloatArray, times: FloatArray, others: FloatArray) -> FloatArray:
    """Return the largest differences (p,) of both derivatives of the states, relative to them.

    Args:
        run: its sample times are those of ``slopes``.
        slopes, others: (p, samples, 2, n, 1 + m).
        times: of ``others``, s; an event that ends a run may move the last sample.
    """
    count = min(len(times), len(run.sample_times))
    same = np.flatnonzero(times[:count] == run.sample_times[:count])
    scaled, reference = (array[:, same] / run.tolerance.unit for array in (slopes, others))
    errors = [
        max(relative_error(a[:, level], b[:, level]) for level in range(2))
        for a, b in zip(scaled, reference, strict=True)
    ]
    return np.array(errors)


def relative_error(array: FloatArray, reference: FloatArray) -> float:
    """Return the largest difference of two arrays, relative to the largest number."""
    size = float(np.abs(reference).max(initial=0.0))
    difference = float(np.abs(array - reference).max(initial=0.0))
    return difference / size if size > 0.0 else difference
