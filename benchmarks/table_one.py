"""Two seconds of the Table I arm: all integrators, several bases, all installed peers.

`python -m benchmarks.table_one` measures and prints only the table of default arguments.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from peers.arms import TABLE_ONE

import flexarm as fa
from benchmarks import programs
from benchmarks.arms import table_one
from benchmarks.work_precision import Entry, Point, measure
from flexarm.integrate import INTEGRATORS

DATA = Path(__file__).resolve().parent.parent / "tests" / "data"
#: Sampled at the rate of the stored exact solution, so that the peers may take steps of 2 ms.
CASE = replace(TABLE_ONE, rate=100)

#: Reference solutions of the paths: files of tests/data, computed by other programs.
EXACT, PAPER = "exact beams", "the paper's 2+1 elements"
_FILES = {EXACT: "tableI_exact.csv", PAPER: "tableI_linear_2p1.csv"}

RTOL = (1e-3, 1e-4, 1e-6)
STEPS = (2e-3, 1e-3, 5e-4, 2.5e-4)
#: Tolerances of a basis whose error is a micrometre.
FINER = {"3 segments of 4 modes": (1e-5, 5e-6)}
EXUDYN = ((2, 2e-3), (4, 2e-3), (4, 1e-3), (8, 2e-4), (8, 1e-4), (16, 1e-4))
EXUDYN_EXACT = ((2, 2e-3), (4, 1e-3), (8, 2e-4))
MUJOCO = ((4, 1e-3), (8, 2.5e-4), (16, 5e-5))
PINOCCHIO = ((4, 1e-3), (8, 2.5e-4))
DRAKE = ((8, 1e-4, 2e-4), (8, 1e-4, 1e-2))
PYELASTICA = (((28, 20), 0.05, 5e-5), ((28, 20), 0.025, 2e-5))
SOROMOX = ((4, 1e-4), (2, 1e-4))
CASADI = (1e-4, 3e-5, 1e-6, 1e-9)
JAX_RTOL = tuple({"rtol": rtol} for rtol in (1e-4, 1e-6, 1e-9))
JAX = ({"step": 5e-4}, {"step": 6.25e-4}, {"step": 1e-3}, *JAX_RTOL)
SCIPY = (("DOP853", 1e-4), ("LSODA", 1e-4))


def second_order(**links: int) -> fa.Arm:
    """Return the arm in the second-order theory."""
    return programs.arm_of(CASE, theory="second_order", **links)


#: Bases of flexarm, and the reference solution to which each converges.
BASES = {
    "2+1 elements": (table_one, PAPER),
    "3 modes": (partial(second_order, elements=16, modes=3), EXACT),
    "4 modes": (partial(second_order, elements=16, modes=4), EXACT),
    "3 segments of 4 modes": (partial(second_order, elements=12, modes=4, segments=3), EXACT),
}


def truths(duration: float) -> dict[str, np.ndarray]:
    """Return the tip paths of the reference solutions, up to ``duration`` (s)."""
    count = round(duration * CASE.rate) + 1
    tables = {
        name: np.loadtxt(DATA / file, delimiter=",", skiprows=1) for name, file in _FILES.items()
    }
    return {name: table[:count, 3:5] for name, table in tables.items()}


def own_entries(
    rtol: tuple[float, ...] = RTOL, steps: tuple[float, ...] = STEPS, duration: float = 2.0
) -> Iterator[Entry]:
    """Yield every integrator of the registry on every basis."""
    case = replace(CASE, duration=duration)
    for basis, (build, truth) in BASES.items():
        for name, integrator in INTEGRATORS.items():
            settings = (
                [{"rtol": value} for value in FINER.get(basis, rtol)]
                if integrator.adaptive
                else [{"step": value} for value in steps]
            )
            for setting in settings:
                yield programs.flexarm(case, basis, build, truth, integrator=name, **setting)


def specialized_entries(
    rtol: tuple[float, ...] = (1e-3, 1e-4), duration: float = 2.0, specialized: bool = True
) -> Iterator[Entry]:
    """Yield ``auto`` compiled for the sizes of two bases, which takes ten seconds each, once."""
    case = replace(CASE, duration=duration)
    for basis in ("2+1 elements", "4 modes"):
        build, truth = BASES[basis]
        for value in rtol:
            yield programs.flexarm(case, basis, build, truth, rtol=value, specialized=specialized)


def default_entries(duration: float = 2.0) -> Iterator[Entry]:
    """Yield what a user gets: default arguments, on reduced bases and on full meshes."""
    case = replace(CASE, duration=duration)
    meshes = partial(second_order, elements=4)
    yield programs.flexarm(case, "4 modes", BASES["4 modes"][0], EXACT)
    yield programs.flexarm(case, "full meshes of 4 + 4", meshes, EXACT)
    yield programs.flexarm(case, "2+1 elements", *BASES["2+1 elements"])


def peer_entries(duration: float = 2.0, quick: bool = False) -> Iterator[Entry]:
    """Yield the settings of every installed peer, or with ``quick`` the cheapest of each."""
    case = replace(CASE, duration=duration)
    count = 1 if quick else None
    missing = programs.missing()
    bodies: tuple[tuple[str, Any, tuple[Any, ...]], ...] = (
        ("Exudyn", programs.exudyn, EXUDYN),
        ("Exudyn", programs.exudyn_exact, EXUDYN_EXACT),
        ("MuJoCo", programs.mujoco, MUJOCO),
        ("Pinocchio", programs.pinocchio, PINOCCHIO),
        ("Drake", programs.drake, DRAKE),
        ("PyElastica", programs.pyelastica, PYELASTICA),
        ("SoRoMoX", programs.soromox, SOROMOX),
    )
    for name, entry, settings in bodies:
        if name not in missing:
            yield from (entry(case, *setting, EXACT) for setting in settings[:count])
    arm = table_one()
    if "CasADi CVODES" not in missing:
        yield from (programs.casadi(case, arm, rtol, PAPER) for rtol in CASADI[:count])
    if "JAX" not in missing:
        yield from (programs.jax(case, arm, PAPER, **setting) for setting in JAX[:count])
    yield from (programs.scipy(case, arm, *setting, PAPER) for setting in SCIPY[:count])


def work_precision(repeats: int = 3) -> tuple[list[Point], list[str]]:
    """Measure all entries alternately."""
    entries = [*own_entries(), *specialized_entries(), *default_entries(), *peer_entries()]
    return measure(entries, truths(CASE.duration), repeats)


def main() -> None:
    """Measure calls with default arguments beside all installed peers, and print their table."""
    from benchmarks.report import user_table

    entries = [*default_entries(), *peer_entries()]
    points, failed = measure(entries, truths(CASE.duration), repeats=5)
    print(*failed, user_table(points), sep="\n")


if __name__ == "__main__":
    main()
