"""Report of the measurements: docs/performance/index.md and its figures."""

from __future__ import annotations

import os
import platform
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from benchmarks import closed_loop, environments, long_chain, pictures, programs, raw, rollouts
from benchmarks.figures import USEFUL, draw_scaling, draw_work_precision
from benchmarks.first_run import First
from benchmarks.forward_dynamics import Comparison
from benchmarks.long_chain import TIGHT
from benchmarks.startup import Wait
from benchmarks.table_one import EXACT, PAPER
from benchmarks.whole_call import GOAL, GOALS, LOOP_GOAL, LOOPS, Whole
from benchmarks.work_precision import Point, fastest

#: Errors (m) at which programs are compared: those that peers reach at low cost.
LEVELS = {EXACT: (1.3e-4, 3.1e-5, 6e-6, 3.1e-6), PAPER: (4e-6, 2e-7)}


class Measured(NamedTuple):
    """All measurements of ``make bench``. Times are in seconds unless another unit is given."""

    imports: float
    help: float
    runs: dict[str, Wait]
    first: list[First]
    memory: dict[str, float]  # MB
    comparisons: list[Comparison]
    links: dict[int, float]  # microseconds a link
    modes: dict[int, float]  # microseconds
    table_one: list[Point]
    raw: list[Point]  # the scan of raw.py and the peers measured with it
    many: list[rollouts.Rollouts]
    learning: environments.Environments
    chain: list[Point]
    closed: list[tuple[str, float, float]]  # rows of closed_loop
    controllers: dict[tuple[str, str], float]  # microseconds a sample, by name and condition
    simulations: list[Whole]
    calls: dict[str, float]  # microseconds
    pictures: dict[str, Wait]


def machine() -> str:
    """Describe the machine and the versions of the programs."""
    names = ("flexarm", "numba", "numpy", "scipy", "exudyn", "mujoco", "pin", "drake")
    names += ("pyelastica", "soromox", "casadi", "jax", "diffrax")
    versions = ", ".join(f"{name} {found}" for name in names if (found := _version(name)))
    python = platform.python_version()
    # The load of the last fifteen minutes: above about one, other processes were running too.
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
    titles = {EXACT: "Against exact beams", PAPER: "Against the paper's 2 + 1 elements"}
    draw_work_precision(folder / "work-precision.png", measured.table_one, titles)
    draw_work_precision(folder / "chain.png", measured.chain, {TIGHT: "64 links, one second"})
    (folder / "index.md").write_text(_page(measured), encoding="utf-8")


def _page(m: Measured) -> str:
    return f"""# Performance

`make bench` measures the numbers on this page, in one run on one machine: {machine()}.

Compare ratios from the same run, because times depend on the machine and its load. Candidates in
one table were timed alternately. Times are medians, except those of the chain, which was timed
once, and of the start-up, which are the minimum of a few runs.

[Accuracy](accuracy.md) of the methods, [controllers compared](controllers.md) and the
[choice of modes](../how-to/choose-the-modes.md#reliability) have pages of their own: they count
errors and evaluations, which do not depend on the machine.

## Forward dynamics, two links of four modes

{_comparison_table(m.comparisons)}

The limit is a C++ template written by hand for this comparison, `benchmarks/limit`, compiled with
`-O3 -march=native`; its accelerations agree to 1e-11. The goal is 1.15 times the limit. The
compiler knows the sizes with `specialized=True` and, by default, in long runs.

## Scaling

{_scaling_table(m.links, m.modes)}

![Cost per link and per evaluation](scaling.png)

## Two seconds of the two-link arm of Table I

The tip error is the largest distance of the tip from a reference solution, every 10 ms. Other
programs computed the two reference solutions with tight error control: one of geometrically exact
beams, and one of the paper's linear theory with 2 + 1 elements. *Integration* is the time in the
loop of each program. *Total* includes the creation of the model and the return of the result, for
flexarm all channels with their labels. No time includes compilation or import.

MuJoCo, Pinocchio and Drake simulate rigid bars on springs; Pinocchio's loop is in Python.
PyElastica's rod is thicker than the links, because otherwise its steps would be ten times shorter;
its error is due to this. In SoRoMoX, segments of a micrometre without stiffness are the joints.
CasADi, JAX and SciPy use flexarm's own equations.

The tables show the fastest setting of each program with at most the given error:

{_level_table(m.table_one)}

### What a user gets

Whole calls with default arguments, which may err by 1e-5 of the reach (2.4e-5 m), beside the
fastest setting of each peer with at most this error (`python -m benchmarks.table_one`).

{user_table(m.table_one)}

![Work-precision diagram](work-precision.png)

In the figure a line joins the best settings of each program; the others are faint.

### Steps alone

Compiled steps with sizes known to the compiler, and whole calls, which include the creation of the
arm and the labels of all channels; each is the best of a scan over integrators, steps, tolerances
and bases (two to five modes, one to twelve segments):

{raw_table(m.raw)}

A whole call also tabulates a torque that is a function of time. A method that resolves the
vibrations needs at least one evaluation for every two radians of the fastest mode of the basis; a
smaller error against the exact beams requires segments, whose modes are faster.

## Many runs

Two seconds of the same arm from {rollouts.RUNS} different starts, each within 0.1 rad of the first.
The error is that of the first run. flexarm stores the tip at 100 Hz; *lanes* are runs computed
eight at a time (decision [0027](../decisions/index.md#0027-lanes)). The ratio is to lanes in all
threads against the same reference. The goal
is {rollouts.GOAL:g} s for {rollouts.RUNS} runs on two idle
cores, {rollouts.RUNS / rollouts.GOAL:.0f} runs per second.

{rollouts.table(m.many)}

## Environments for learning

A step of `flexarm/Reach-v0` simulates two links for 5 ms at the default tolerances, and returns
observation, reward and info. The episodes have 600 steps with random actions, up to half of the
largest torque. The goal is {environments.GOAL:,} steps
per second on two idle cores, and at most {environments.OUTSIDE:.0%} of the time of a single
environment outside `Plant.step`; here it was {m.learning.outside:.0%}.

{environments.table(m.learning)}

## A chain of 64 links

The chain of 64 links on free hinges swings under gravity for one second, without damping. The
reference is flexarm with eight second-order modes per link at `rtol=1e-7`; MuJoCo's rigid bars and
Exudyn's cables converge to the same motion. Rows are left out if another of the same program is
faster and as accurate.

{_points_table(m.chain)}

The goal is {long_chain.GOAL:g} times the speed of MuJoCo at the same error or less:

{chain_table(m.chain)}

![Work-precision diagram of the chain](chain.png)

## A four-bar of flexible links

A crank of 0.3 m starts with 12 rad/s; coupler and rocker are 0.9 and 0.7 m. All bars have 200 N m²
and 0.5 kg/m and swing under gravity for one second. The error is that of the rocker's tip from
{_finest()}, which the [gallery](../gallery/mechanisms.md) compares with
Exudyn, whose links stretch by as much as a steel rod. Times are those of whole calls of `simulate`,
and of the solver of Exudyn. The goal is
{closed_loop.GOAL:g} times the speed of Exudyn at equal error.
`python -m benchmarks.closed_loop` prints this table alone.

{closed_loop.table(m.closed)}

## Controllers

Time of one `update` in closed loops on two flexible links, at the default sample times. The goal
is 20 microseconds for controllers in closed form. If the payload is unknown, `estimator` has up to
25 Gaussians.

{_controllers_table(m.controllers)}

## Whole calls

Two seconds of the two-link arm of Table I with four modes on each link. Outside its steps,
`simulate` checks its arguments, computes and labels the channels, and estimates the error of bent
states.

{whole_table(m.simulations)}

Calls from Python, with all arguments as arrays:

{calls_table(m.calls)}

## Pictures

Animations have 30 frames per second, 1120 pixels in width and three histories.

{pictures_table(m.pictures)}

## Start-up

{_startup_table(m)}

## First run

Each feature runs in its own process, whose start is included. The first two columns are with the
library of kernels, the next two without it: the first two features then compile from nothing, the
others with the cache after `simulate`. The goals are seconds of compiling on two idle cores.

{first_run_table(m.first)}

## Memory

{_table(("content", "MB"), [(name, f"{size:.0f}") for name, size in m.memory.items()])}
"""


def _finest() -> str:
    """Describe the reference of the four-bar."""
    segments, modes, rtol = closed_loop.FINEST
    return f"{segments} segments of {modes} modes at `rtol={rtol:g}`"


def _table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [header, tuple("---" for _ in header), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _comparison_table(comparisons: list[Comparison]) -> str:
    """Return the table of implementations, with time and ratio for each theory."""
    columns = []
    for c in comparisons:
        base = c.limit if c.limit is not None else c.compile_time_sizes
        times = (
            *(c.limit, c.limit_run_time_sizes, c.compile_time_sizes, c.run_time_sizes),
            *(c.from_python, c.scipy_dense),
        )
        columns.append([_against(time, base) for time in times])
    names = (
        "C++ template, sizes known to the compiler: the limit",
        "C++, sizes at run time",
        "flexarm in compiled code, sizes known to the compiler",
        "flexarm in compiled code, sizes at run time",
        "`arm.forward_dynamics` called from Python",
        "SciPy: Cholesky of `arm.mass_matrix`, solve for `arm.bias_force`",
    )
    heads = [cell for c in comparisons for cell in (f"{c.theory} (microseconds)", "ratio")]
    cells = zip(names, *columns, strict=True)
    rows = [(name, *(cell for pair in pairs for cell in pair)) for name, *pairs in cells]
    return _table(("implementation", *heads), rows)


def _against(time: float | None, base: float) -> tuple[str, str]:
    """Return the cells of a time and of its ratio to another one."""
    return ("no compiler here", "") if time is None else (f"{time:.3g}", f"{time / base:.3g}")


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
    """Return a table for each reference solution."""
    tables = []
    names = list(dict.fromkeys(point.program for point in points))
    header = ("error at most (m)", "setting", "integration (ms)", "total (ms)", "ratio")
    for truth, levels in LEVELS.items():
        rows = []
        for level in levels:
            own = fastest([p for p in points if p.program == "flexarm"], truth, level)
            for program in names:
                best = fastest([p for p in points if p.program == program], truth, level)
                if best is None:
                    continue
                ratio = f"{best.seconds / own.seconds:.3g}" if own else ""
                times = f"{1e3 * best.seconds:.3g}", f"{1e3 * best.total:.3g}"
                rows.append((f"{level:.1e}", f"{program}, {best.setting}", *times, ratio))
        tables.append(f"Against {truth}:\n\n{_table(header, rows)}")
    return "\n\n".join(tables)


def user_table(points: list[Point]) -> str:
    """Return the table of whole calls with default arguments, beside each peer as accurate."""
    rows = []
    for own in points:
        if own.program != "flexarm" or programs.DEFAULTS not in own.setting:
            continue
        rows.append((own.setting, f"{own.error:.1e}", f"{1e3 * own.total:.3g}", "flexarm", "", ""))
        for program in dict.fromkeys(point.program for point in points):
            peers = [point for point in points if point.program == program]
            best = fastest(peers, own.truth, own.error, whole=True)
            if best is None or program == "flexarm":
                continue
            cells = f"{best.error:.1e}", f"{1e3 * best.total:.3g}", program, best.setting
            rows.append(("", *cells, f"{best.total / own.total:.3g}"))
    header = (
        "default call",
        "tip error (m)",
        "whole call (ms)",
        "program",
        "tuned setting",
        "ratio",
    )
    text = _table(header, rows)
    if missing := programs.missing():
        text += f"\n\nNot installed in this run: {', '.join(missing)}."
    return text


def raw_table(points: list[Point]) -> str:
    """Return the table of ``raw.beside_peers``: a row for the steps above one for whole calls."""
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
            stated = f"{goal:g}" if goal else ""
            rows.append((truth, f"{level:.1e}", what, *cells, ratio, stated))
    header = ("against", "error at most (m)", "what", "flexarm (ms)", "fastest peer (ms)")
    return _table((*header, "ratio", "goal"), rows)


def chain_table(points: list[Point]) -> str:
    """Return the table of MuJoCo's runs of the chain, each with our fastest as accurate."""
    own = [point for point in points if point.program == "flexarm"]
    rows = []
    for point in points:
        if point.program == "MuJoCo":
            best = fastest(own, TIGHT, point.error)
            cells = ("none", "")
            if best:
                ratio = point.seconds / best.seconds
                cells = f"{best.setting}: {1e3 * best.seconds:.3g}", f"{ratio:.3g}"
            theirs = f"{point.setting}: {1e3 * point.seconds:.3g}"
            rows.append((f"{point.error:.1e}", cells[0], theirs, cells[1], f"{long_chain.GOAL:g}"))
    header = ("error at most (m)", "flexarm (ms)", "MuJoCo (ms)", "ratio", "goal")
    return _table(header, rows)


def _points_table(points: list[Point]) -> str:
    """Return the table of points with one reference solution, the fastest first.

    Without points to which another one of the same program is superior.
    """
    best: dict[str, float] = {}
    fast = []
    for point in sorted(points, key=lambda point: point.seconds):
        if point.error < min(USEFUL, best.get(point.program, USEFUL)):
            best[point.program] = point.error
            fast.append(point)
    rows = [
        (
            point.program,
            point.setting,
            f"{point.error:.1e}",
            f"{1e3 * point.seconds:.3g}",
            f"{1e3 * point.total:.3g}",
        )
        for point in fast
    ]
    header = ("program", "setting", "tip error (m)", "integration (ms)", "total (ms)")
    return _table(header, rows)


def _controllers_table(found: dict[tuple[str, str], float]) -> str:
    rows = [
        (f"`{name}`" + (f", {condition}" if condition else ""), f"{time:.3g}")
        for (name, condition), time in found.items()
    ]
    return _table(("controller", "microseconds"), rows)


def whole_table(found: list[Whole]) -> str:
    """Return the table of the measurements of ``whole_call.simulations``."""
    goals = dict.fromkeys(LOOPS, LOOP_GOAL)
    rows = [
        (name, *(f"{1e3 * value:.2f}" for value in times), f"{goals.get(name, GOAL):g}")
        for name, *times in found
    ]
    return _table(("run", "steps (ms)", "whole call (ms)", "outside its steps (ms)", "goal"), rows)


def calls_table(found: dict[str, float]) -> str:
    """Return the table of the measurements of ``whole_call.microseconds``."""
    rows = [
        (name, f"{value:.3g}", f"{goal:g}" if (goal := GOALS[name]) else "")
        for name, value in found.items()
    ]
    return _table(("call", "microseconds", "goal"), rows)


def _startup_table(m: Measured) -> str:
    rows = [
        ("`import flexarm`, without the start of Python", f"{m.imports:.2f}", "", "0.3"),
        ("`flexarm --help`, with the start of the process", f"{m.help:.2f}", "", "0.3"),
    ]
    for (name, wait), goal in zip(m.runs.items(), ("3", "2"), strict=True):
        rows.append((name, *_cells(wait), goal))
    return _table(("measurement", "seconds", "CPU seconds", "goal"), rows)


def pictures_table(found: dict[str, Wait]) -> str:
    """Return the table of the measurements of ``pictures.waits``."""
    rows = [
        (name, *_cells(wait), f"{pictures.GOALS[name.split()[0]]:g}")
        for name, wait in found.items()
    ]
    return _table(("picture", "seconds", "CPU seconds", "goal"), rows)


def first_run_table(found: Sequence[First]) -> str:
    """Return the table of the measurements of ``first_run.first_uses``."""
    rows = [
        (one.feature.name, *_cells(one.library), *_cells(one.wait), f"{one.feature.goal:g}")
        for one in found
    ]
    header = ("first use of", "seconds", "CPU seconds", "seconds, compiling", "CPU seconds", "goal")
    return _table(header, rows)


def _cells(wait: Wait) -> tuple[str, str]:
    return f"{wait.wall:.2f}", f"{wait.processor:.2f}"
