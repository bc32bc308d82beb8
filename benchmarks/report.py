"""Write what was measured: docs/performance/index.md and its figures."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from benchmarks import raw
from benchmarks.figures import USEFUL, draw_scaling, draw_work_precision
from benchmarks.first_run import First
from benchmarks.forward_dynamics import Comparison
from benchmarks.long_chain import TIGHT
from benchmarks.startup import Wait
from benchmarks.table_one import EXACT, PAPER
from benchmarks.whole_call import GOAL, GOALS, Whole
from benchmarks.work_precision import Point, fastest

#: Errors at which programs are compared, m: those that peers reached cheaply.
LEVELS = {EXACT: (1.3e-4, 3.1e-5, 6e-6, 3.1e-6), PAPER: (4e-6, 2e-7)}


class Measured(NamedTuple):
    """Everything that ``make bench`` measures. Times in seconds, unless said otherwise."""

    imports: float
    help: float
    runs: dict[str, Wait]
    first: list[First]
    memory: dict[str, float]  # MB
    comparisons: list[Comparison]
    links: dict[int, float]  # microseconds a link
    modes: dict[int, float]  # microseconds
    table_one: list[Point]
    raw: list[Point]  # the scan of raw.py and the peers beside it
    chain: list[Point]
    controllers: dict[tuple[str, str], float]  # microseconds a sample, by name and condition
    simulations: list[Whole]
    calls: dict[str, float]  # microseconds


def machine() -> str:
    """Describe where the numbers were measured."""
    names = ("flexarm", "numba", "numpy", "scipy", "exudyn", "mujoco", "pin", "drake")
    names += ("pyelastica", "casadi", "jax", "diffrax")
    versions = ", ".join(f"{name} {found}" for name in names if (found := _version(name)))
    python = platform.python_version()
    # Of the last fifteen minutes: more than about one says that others were at work too.
    cores = f"{os.cpu_count()} cores (load {os.getloadavg()[2]:.1f})"
    return f"{platform.machine()}, {cores}, Python {python}, {versions}"


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def write(folder: Path, measured: Measured) -> None:
    """Write the page and its figures into ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    draw_scaling(folder / "scaling.png", measured.links, measured.modes)
    titles = {EXACT: "against the exact beams", PAPER: "the paper's 2+1 elements"}
    draw_work_precision(folder / "work-precision.png", measured.table_one, titles)
    draw_work_precision(folder / "chain.png", measured.chain, {TIGHT: "64 links, one second"})
    (folder / "index.md").write_text(_page(measured), encoding="utf-8")


def _page(m: Measured) -> str:
    return f"""# Performance

Measured by `make bench`; the numbers below are from one run on one machine: {machine()}. Times
vary from machine to machine and with what else runs on it; ratios taken in the same run are
what to compare. What is compared was timed in turns. Times are medians, but for the chain, timed
once, and start-up, the least of a few.

## Forward dynamics, two links of four modes

{_comparison_table(m.comparisons)}

The limit is a C++ template with the sizes known to the compiler, `benchmarks/limit`, written by
hand for nothing but this and compiled with `-O3 -march=native`; it gives the same accelerations
to 1e-11 before it is timed. The goal is 1.5 times the limit; it is met where the compiler knows
the sizes (`specialized=True`, and runs of more than a minute by themselves). Other runs take the
code for any size, which needs no compiling for each arm.

## Scaling

{_scaling_table(m.links, m.modes)}

![Cost per link and per evaluation](scaling.png)

## Two seconds of the two-link arm of Table I

Largest distance of the tip, every 10 ms, from solutions that other programs computed with tight
error control: that of geometrically exact beams, and that of the paper's linear theory with 2 +
1 elements. Integration: the time in each program's own loop. Total: with building the model and
handing over the result, for flexarm every channel with its labels. Compiling and importing are
left out everywhere. MuJoCo, Pinocchio and Drake move rigid bars on springs; Pinocchio has no
integrators, its loop is in Python. PyElastica's rod is thicker than the links, or its steps would
be ten times shorter; that is what it errs by. CasADi and JAX have flexarm's own equations, CasADi
with exact Jacobians; SciPy's solvers call them from Python.

The fastest of each that is at least so accurate:

{_level_table(m.table_one)}

![Work-precision diagram](work-precision.png)

### Steps and whole calls

The compiled steps of flexarm where the compiler knows the sizes, and the whole call that makes
them, with the arm built and every channel labelled: each the best of a scan over integrators,
steps, tolerances and bases, beside the peer that is the fastest in the same respect, timed in turns
with it:

{raw_table(m.raw)}

A whole call also makes a table of a torque that is a function of time, to the tolerance in use,
and computes and labels channels. That is the rest of the total.

What bounds the steps: a method that follows vibrations needs an evaluation, at least, for every
two radians of the fastest mode that is kept, and one that does not has to resolve the motion.
An evaluation takes what the first table says. More digits against the exact beams take segments,
whose modes are faster. Every integrator was tried on bases of two to five modes and one to twelve
segments; the tables hold the best.

### All runs

Every run, fastest first; those that err by more than {1e3 * USEFUL:g} mm are left out:

{_points_table(m.table_one)}

## A chain of 64 links

One second of 64 links on free hinges that swing under gravity, four second-order modes a link,
without damping, against flexarm with eight modes a link at `rtol=1e-7`. MuJoCo's rigid bars and
Exudyn's cables tend to the same motion. Each was timed once, after one run to warm up.

{_points_table(m.chain)}

![Work-precision diagram of the chain](chain.png)

## Controllers

Time of one `update` in closed loops on two flexible links, at the default sample times: medians
of runs in turns. The goal is 20 for those that have a closed form. `mpc` is the regulator where
no limit is within reach of its horizon, and solves a quadratic program where one is. The filter
of `estimator` linearises a step of the equations of motion; while the payload is unknown it does
so for up to 25 Gaussians.

{_controllers_table(m.controllers)}

## Whole calls

Two seconds of the two-link arm of Table I with four modes on each link. Beside its steps
`simulate` checks its arguments, finds the fastest vibration, computes and labels the channels, and
estimates the error of bent states. That includes compiled code that computes the channels of each
sample. Runs of the same arm share the labels if their samples are at the same times.

{whole_table(m.simulations)}

Calls from Python, an argument of every kind as an array:

{calls_table(m.calls)}

## Start-up

{_startup_table(m)}

## First run

Each feature in a process of its own, process start included, which compiles on the way. The first
two begin with an empty cache of machine code; each of the others begins with what `simulate` left.
`flexarm warmup` compiles all of them at once. Seconds of one processor exceed the seconds where
several processes work; the goals are seconds on two idle cores.

{first_run_table(m.first)}

## Memory

{_table(("what", "MB"), [(name, f"{size:.0f}") for name, size in m.memory.items()])}
"""


def _table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _comparison_table(comparisons: list[Comparison]) -> str:
    rows = []
    for c in comparisons:
        base = c.limit if c.limit is not None else c.compile_time_sizes
        for what, time in (
            ("C++ template, sizes known to the compiler: the limit", c.limit),
            ("C++, sizes at run time", c.limit_run_time_sizes),
            ("flexarm in compiled code, sizes known to the compiler", c.compile_time_sizes),
            ("flexarm in compiled code, sizes at run time", c.run_time_sizes),
            ("Python calls `arm.forward_dynamics`", c.from_python),
            ("SciPy: Cholesky of `arm.mass_matrix`, solve for `arm.bias_force`", c.scipy_dense),
        ):
            if time is None:
                rows.append((c.theory, what, "no compiler here", ""))
            else:
                rows.append((c.theory, what, f"{time:.3g}", f"{time / base:.3g}"))
    return _table(("theory", "who calls what", "microseconds", "ratio"), rows)


def _scaling_table(links: dict[int, float], modes: dict[int, float]) -> str:
    first = _table(
        ("links of four modes", "microseconds per link"),
        [(str(count), f"{time:.3f}") for count, time in links.items()],
    )
    second = _table(
        ("all modes of half as many elements on each of two links", "microseconds per evaluation"),
        [(str(count), f"{time:.3f}") for count, time in modes.items()],
    )
    return f"{first}\n\n{second}"


def _level_table(points: list[Point]) -> str:
    rows = []
    programs = list(dict.fromkeys(point.program for point in points))
    for truth, levels in LEVELS.items():
        for level in levels:
            own = fastest([p for p in points if p.program == "flexarm"], truth, level)
            for program in programs:
                best = fastest([p for p in points if p.program == program], truth, level)
                if best is None:
                    continue
                ratio = f"{best.seconds / own.seconds:.3g}" if own else ""
                name, total = f"{program}, {best.setting}", f"{1e3 * best.total:.3g}"
                rows.append(
                    (truth, f"{level:.1e}", name, f"{1e3 * best.seconds:.3g}", total, ratio)
                )
    header = ("against", "error at most (m)", "fastest", "integration (ms)", "total (ms)", "ratio")
    return _table(header, rows)


def raw_table(points: list[Point]) -> str:
    """Return the table of what ``raw.beside_peers`` measured: steps above whole calls."""
    own = [point for point in points if point.program == raw.PROGRAM]
    peers = [point for point in points if point.program != raw.PROGRAM]
    rows = []
    for truth, level, *goals in raw.LEVELS:
        for whole, goal in zip((False, True), goals, strict=True):
            best = [fastest(side, truth, level, whole) for side in (own, peers)]
            times = [point and 1e3 * (point.total if whole else point.seconds) for point in best]
            cells = ["none", "none"]
            if best[0]:
                cells[0] = f"{best[0].setting}: {times[0]:.3g}"
            if best[1]:
                cells[1] = f"{best[1].program}, {best[1].setting}: {times[1]:.3g}"
            ratio = f"{times[1] / times[0]:.3g}" if times[0] and times[1] else ""
            what = "whole call" if whole else "steps"
            told = f"{goal:g}" if goal else ""
            rows.append((truth, f"{level:.1e}", what, *cells, ratio, told))
    header = ("against", "error at most (m)", "what", "flexarm (ms)", "fastest peer (ms)")
    return _table((*header, "ratio", "goal"), rows)


def _points_table(points: list[Point]) -> str:
    rows = [
        (
            point.truth,
            point.program,
            point.setting,
            f"{point.error:.1e}",
            f"{1e3 * point.seconds:.3g}",
            f"{1e3 * point.total:.3g}",
        )
        for point in sorted(points, key=lambda point: (point.truth, point.seconds))
        if point.error < USEFUL
    ]
    header = ("against", "program", "setting", "tip error (m)", "integration (ms)", "total (ms)")
    return _table(header, rows)


def _controllers_table(found: dict[tuple[str, str], float]) -> str:
    unit = found["joint_pd", ""]
    rows = [
        (f"`{name}`", condition, f"{time:.3g}", f"{time / unit:.3g}")
        for (name, condition), time in found.items()
    ]
    return _table(("controller", "condition", "microseconds", "times `joint_pd`"), rows)


def whole_table(found: list[Whole]) -> str:
    """Return the table of what ``whole_call.simulations`` measured."""
    rows = [
        (name, *(f"{1e3 * value:.2f}" for value in times), f"{GOAL:g}") for name, *times in found
    ]
    return _table(("run", "steps (ms)", "whole call (ms)", "beside its steps (ms)", "goal"), rows)


def calls_table(found: dict[str, float]) -> str:
    """Return the table of what ``whole_call.microseconds`` measured."""
    rows = [
        (name, f"{value:.3g}", f"{goal:g}" if (goal := GOALS[name]) else "")
        for name, value in found.items()
    ]
    return _table(("call", "microseconds", "goal"), rows)


def _startup_table(m: Measured) -> str:
    rows = [
        ("`import flexarm`, beyond starting Python", f"{m.imports:.2f}", "", "0.3"),
        ("`flexarm --help`, process start included", f"{m.help:.2f}", "", "0.3"),
    ]
    for (name, wait), goal in zip(m.runs.items(), ("3", "2"), strict=True):
        rows.append((name, *_cells(wait), goal))
    return _table(("what", "seconds", "of one processor", "goal"), rows)


def first_run_table(found: Sequence[First]) -> str:
    """Return the table of what ``first_run.first_uses`` measured."""
    rows = [(one.feature.name, *_cells(one.wait), f"{one.feature.goal:g}") for one in found]
    return _table(("first use of", "seconds", "of one processor", "goal"), rows)


def _cells(wait: Wait) -> tuple[str, str]:
    return f"{wait.wall:.2f}", f"{wait.processor:.2f}"
