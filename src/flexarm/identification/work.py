"""Records whose times are probably in another unit: a fit of them would hardly end."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm import Arm
from flexarm.errors import FlexarmWarning, InputError, warn_caller
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import Space
from flexarm.linear import modes
from flexarm.simulation.choice import integrator_of

#: Phase (rad) of the slowest vibration from sample to sample above which a record misses it.
_UNRESOLVED = np.pi
#: Evaluations of the dynamics times coordinates of a fit, about ten seconds; and runs of a fit for
#: each free number.
_LONG, _RUNS = 3e7, 10.0


def warn_of_work(runs: Sequence[RecordRun], space: Space) -> None:
    """Warn of records that take long and whose samples are too far apart to contain a vibration."""
    for k, run in enumerate(runs):
        case = space.case(k, space.start)
        arm = Arm(case.spec)
        frequency = modes(arm).frequency_hz
        frequency = frequency[frequency > 0.0]
        if not frequency.size:
            continue
        phase = 2.0 * np.pi * float(frequency[0]) / run.record.rate
        if phase <= _UNRESOLVED:
            continue
        arguments = run.arguments(case)
        duration, integrator = arguments.pop("duration"), arguments.pop("integrator", "auto")
        step = arguments.pop("step", None)
        try:
            work = integrator_of(arm, duration, integrator, step, arguments).work
        except InputError:  # a hopeless run
            work = np.inf
        work *= _RUNS * (1 + len(space.slots))
        if work * arm.dof > _LONG:
            text = (
                f"{run.name}: lasts {run.record.duration:.6g} s with a sample every "
                f"{1.0 / run.record.rate:.3g} s, in which the slowest vibration of the arm turns "
                f"by {phase:.2g} rad, and a fit would take about {work:.0e} evaluations of the "
                "dynamics. Times are in seconds: are these in milliseconds?"
            )
            warn_caller(text, FlexarmWarning)
