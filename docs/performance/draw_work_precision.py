"""Error against time of every integrator: the figure of the page "Accuracy".

Two seconds of the arm of Table I, driven as in ``measure_integrators.py``, with three bases: the
paper's two and one elements; four modes a link, second-order theory; sixteen elements a link, whose
fastest vibrations nobody sees. Every integrator of the registry runs over its tolerances or steps,
all in turns. Errors are the largest distance of the tip from that of a run with a tight tolerance.

    python docs/performance/draw_work_precision.py
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from measure_integrators import Torque

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from flexarm.simulation.histories.piecewise import function_history
from flexarm.view.plot.palette import series_colors
from flexarm.view.plot.style import Sheet, styled

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from gallery.line_labels import label_lines

FIGURE = Path(__file__).with_name("integrators.png")
DURATION = 2.0
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
#: Errors beyond this are those of a step too long (m); below this, of the reference.
USEFUL, EXACT = 1e-2, 2e-11
TOLERANCES = tuple(10.0**-k for k in range(1, 11))
STEPS = tuple(4e-3 * 2.0**-k for k in range(9))
#: A run that takes longer says enough (s): nothing tighter is tried, and it is not repeated.
PATIENCE = 4.0


class Basis(NamedTuple):
    """An arm, and what to write above its panel."""

    title: str
    theory: str
    links: tuple[dict[str, Any], dict[str, Any]]

    def arm(self) -> fa.Arm:
        lengths = (1.4142, 1.0)
        links = [
            fa.Link(length=length, **ROD, **own)
            for length, own in zip(lengths, self.links, strict=True)
        ]
        return fa.Arm(links=links, theory=self.theory)


BASES = (
    Basis("2 + 1 elements", "linear", ({"elements": 2}, {"elements": 1})),
    Basis("4 + 4 modes", "second_order", ({"elements": 16, "modes": 4},) * 2),
    Basis("16 + 16 elements", "linear", ({"elements": 16},) * 2),
)


class Point(NamedTuple):
    """One integrator at one setting."""

    integrator: str
    setting: float  # relative tolerance, or step in s
    error: float  # m
    seconds: float


class Case:
    """One arm, and the motion that its runs are judged by."""

    def __init__(self, basis: Basis, duration: float = DURATION) -> None:
        self.arm, self.duration = basis.arm(), duration
        # In advance, because a run would tabulate it to its own tolerance, in a time that counts.
        breaks = np.array(Torque.breaks)
        self.torque = function_history(Torque(), duration, 2, 1e-9, breaks, spacing=0.01)
        self.exact = self.run("dormand_prince_8", rtol=1e-11, atol=1e-13).tip.values

    def run(self, integrator: str, **setting: float) -> Any:
        start = self.arm.rest([np.pi / 4, -np.pi / 2])
        return fa.simulate(
            self.arm,
            self.duration,
            torque=self.torque,
            initial=start,
            integrator=integrator,
            rate=100.0,
            progress=False,
            **setting,
        )

    def measured(self, integrator: str, setting: float) -> Point | None:
        """One run; None where it fails or its error says nothing."""
        options = {"rtol": setting, "atol": setting / 100}
        if not INTEGRATORS[integrator].adaptive:
            options = {"step": setting}
        try:
            with warnings.catch_warnings():  # far too long a step may bend the arm by miles
                warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
                result = self.run(integrator, **options)
        except fa.SimulationError:
            return None
        error = float(np.hypot(*(result.tip.values - self.exact).T).max())
        if not EXACT < error < USEFUL:
            return None
        return Point(integrator, setting, error, result.attrs["wall_seconds"])


def measure(
    case: Case,
    repeats: int,
    tolerances: Sequence[float] = TOLERANCES,
    steps: Sequence[float] = STEPS,
) -> list[Point]:
    """Every integrator at every setting that is of use; the shortest time of all repeats."""
    found: list[Point] = []
    for name, method in INTEGRATORS.items():
        for setting in tolerances if method.adaptive else steps:
            point = case.measured(name, setting)
            found += [] if point is None else [point]
            if point is not None and point.seconds > PATIENCE:
                break
    for _ in range(repeats - 1):  # in turns: a busy moment of the machine hits all alike
        for k, old in enumerate(found):
            if old.seconds > PATIENCE:
                continue
            again = case.measured(old.integrator, old.setting)
            assert again is not None  # the same run was of use before
            found[k] = old._replace(seconds=min(old.seconds, again.seconds))
    return found


def draw(path: Path, panels: dict[str, list[Point]]) -> None:
    """Draw a panel for each basis, below each other, each line with its name."""
    sheet = Sheet(6.4, 2.35 * len(panels) + 0.5, layout="constrained")
    with styled():
        parts = sheet.subplots(len(panels), 1, squeeze=False, sharex=True)[:, 0]
        for axes, (title, points) in zip(parts, panels.items(), strict=True):
            axes.set(title=title, ylabel="tip error [m]", xscale="log", yscale="log")
            axes.set_ylim(EXACT, USEFUL)
            axes.set_yticks([10.0**k for k in (-10, -8, -6, -4, -2)])
            axes.minorticks_off()
            axes.margins(x=0.03)
            axes.grid(True, axis="both")
            _draw_lines(axes, points)
        parts[-1].set_xlabel("time of the run [ms]")
        parts[-1].xaxis.set_major_formatter("{x:g}")
        for axes in parts:
            label_lines(axes)
    sheet.savefig(path, format="png")


def _draw_lines(axes: Axes, points: list[Point]) -> None:
    for name, color in zip(INTEGRATORS, series_colors(len(INTEGRATORS)), strict=True):
        own = sorted((p for p in points if p.integrator == name), key=lambda p: p.error)
        if own:
            times, errors = [1e3 * p.seconds for p in own], [p.error for p in own]
            axes.plot(times, errors, "o-", color=color, markersize=2.5, linewidth=1.1, label=name)


if __name__ == "__main__":
    draw(FIGURE, {basis.title: measure(Case(basis), repeats=5) for basis in BASES})
