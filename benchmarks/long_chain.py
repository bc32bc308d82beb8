"""One second of a swinging chain of 64 flexible links: all integrators, all installed peers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from peers.arms import Case

from benchmarks import programs
from benchmarks.work_precision import Entry, Point, measure
from flexarm.integrate import INTEGRATORS

#: A straight, inclined chain, released from rest and fixed at one end: 64 hinges, flexible links.
CASE = Case(
    name="swinging chain",
    lengths=(0.5,) * 64,
    flexural_rigidity=20.0,
    axial_rigidity=1e8,
    mass_per_length=0.5,
    start=(-1.2,) * 64,
    gravity=9.81,
    duration=1.0,
    segments=1,
    amplitude=(0.0,) * 64,
    rate=100,
)
TIGHT = "flexarm at rtol 1e-7"
#: Goal for the speed of the integration, as a multiple of MuJoCo's.
GOAL = 20.0
RTOL = (1e-3, 1e-4, 1e-5)
STEPS = (1e-3, 5e-4, 2.5e-4)
#: Steps far too long for the stiff modes, with the tolerance of the equations of a step.
LONG_STEPS = ({"step": 4e-3, "rtol": 1e-4}, {"step": 2e-3, "rtol": 1e-4})
EXUDYN = ((2, 1e-3), (4, 1e-3), (4, 5e-4))
BARS = ((1, 1e-3), (2, 1e-3))


def short(links: int, duration: float) -> Case:
    """Return the case with fewer links and a shorter duration."""
    return replace(
        CASE,
        lengths=CASE.lengths[:links],
        start=CASE.start[:links],
        amplitude=CASE.amplitude[:links],
        duration=duration,
    )


def entries(case: Case = CASE) -> Iterator[Entry]:
    """Yield the entries: flexarm with four second-order modes per link, and the peers."""
    build = partial(programs.arm_of, case, theory="second_order", elements=4, modes=4)
    for name, integrator in INTEGRATORS.items():
        settings = (
            [{"rtol": value} for value in RTOL]
            if integrator.adaptive
            else [{"step": value} for value in STEPS]
        )
        if name == "generalized_alpha":
            settings += LONG_STEPS
        for setting in settings:
            yield programs.flexarm(case, "4 modes", build, TIGHT, integrator=name, **setting)
    missing = programs.missing()
    if "Exudyn" not in missing:
        yield from (programs.exudyn(case, *setting, TIGHT) for setting in EXUDYN)
    if "MuJoCo" not in missing:
        yield from (programs.mujoco(case, *setting, TIGHT) for setting in BARS)
    if "Pinocchio" not in missing:
        yield from (programs.pinocchio(case, *setting, TIGHT) for setting in BARS)


def truth(case: Case) -> dict[str, np.ndarray]:
    """Return the tip path with eight modes per link at a tight tolerance."""
    arm = programs.arm_of(case, theory="second_order", elements=4)
    return {TIGHT: programs.simulate(case, arm, rtol=1e-7).path}


def work_precision(case: Case = CASE, repeats: int = 1) -> tuple[list[Point], list[str]]:
    """Measure all entries alternately."""
    return measure(list(entries(case)), truth(case), repeats)
