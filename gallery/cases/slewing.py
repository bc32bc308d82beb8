"""A beam on a hub under a step of motor torque: the first swing, and the vibration that follows."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION, legend_above
from gallery.beam import unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

HUB, TORQUE = 0.1, 1e-5
ELEMENTS, MODES = 32, 16
DURATION = 4.0
REASON = (
    f"the step excites all modes; the error of {ELEMENTS} elements and {MODES} shapes is about "
    "5e-8 of the largest value"
)

PHYSICS = r"""
A beam with $L = EI = \mu = 1$ on a hub of inertia 0.1 is at rest; at $t = 0$ the motor torque
jumps to a small constant. The hub leads and the tip lags. In world axes, the tip even starts in
the wrong direction: this is the non-minimum phase that makes tip control hard. The reference is the
modal series of the linear problem, with nine digits. The torque here is $10^{-5}$, so small that
centrifugal terms are negligible.

The tip vibrates about the static deflection under the inertia forces of the steady acceleration,
$-\frac{11}{120}\big/(0.1 + \frac13)$.

The package: `fa.simulate` with a constant torque; the mean from `arm.mass_matrix` and
`arm.stiffness_matrix`.
"""


@cache
def run() -> xr.Dataset:
    """The simulated swing."""
    arm = unit_beam(ELEMENTS, hub=HUB, modes=MODES)
    return fa.simulate(arm, DURATION, torque=lambda t: [TORQUE], rate=500.0, rtol=1e-10, atol=1e-16)


def mean_deflection() -> float:
    """Static tip deflection under the inertia forces of the steady acceleration, per N m."""
    arm = unit_beam(ELEMENTS, hub=HUB)
    straight = arm.rest([0.0])
    M, K = arm.mass_matrix(straight), arm.stiffness_matrix(straight)
    q = straight.copy()
    q[1:] = np.linalg.solve(K[1:, 1:], -M[1:, 0] / M[0, 0])
    return float(arm.nodal(q)[0][-1, 0])


def quantities() -> list[Row]:
    known, mean = reference("slewing", "step"), reference("slewing", "mean")
    result = run()
    rows = []
    for name, t in (("half", 0.5), ("one", 1.0)):
        state = result.sel(time=t, method="nearest")
        angle = float(state.joint_angle[0]) / TORQUE
        deflection = float(state.link_tip_deflection[0]) / TORQUE
        for key, unit, ours, scale in (
            ("angle", "rad/(N m)", angle, None),
            ("deflection", "m/(N m)", deflection, 0.4),
        ):
            theirs = known.values[f"{key}_{name}"]
            quantity = f"{'joint angle' if key == 'angle' else 'tip deflection'} at {t:g} s"
            rows.append(Row(quantity, unit, known.source, theirs, ours, 6.8, REASON, scale))
    printed = "all eight printed decimals"
    name = "mean tip deflection"
    ours = mean_deflection()
    rows.append(Row(name, "m/(N m)", mean.source, mean.values, ours, 7.6, printed))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    result, known = run(), reference("slewing", "step").values
    t = result.time.values
    left.plot(t, result.joint_angle.values[:, 0] / TORQUE, color=BLUE, label="joint")
    left.plot(t, t**2 / 2 / (HUB + 1 / 3), color=GREY, linestyle=(0, (4, 2)), label="rigid")
    left.plot([0.5, 1], [known["angle_half"], known["angle_one"]], **OURS, color=INK, label="known")
    left.set(xlabel="time [s]", ylabel="angle [rad/(N m)]", xlim=(0, 2), ylim=(0, 5))
    left.set_xticks([0, 0.5, 1, 1.5, 2])
    right.plot(t, result.link_tip_deflection.values[:, 0] / TORQUE, color=VERMILLION)
    points = [known["deflection_half"], known["deflection_one"]]
    right.plot([0.5, 1], points, **OURS, color=INK)
    mean = reference("slewing", "mean").values
    right.axhline(mean, color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
    right.text(1.01 * DURATION, mean, "mean", fontsize=8, color=GREY, va="center")
    right.set(xlabel="time [s]", ylabel="tip deflection [m/(N m)]", xlim=(0, DURATION))
    left.set_title("Joint")
    right.set_title("Beam")
    legend_above(left)


CASE = Case(
    name="slewing",
    title="Step of motor torque",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the joint leads the rigid arm and then pauses until the beam follows. Right: "
    "the tip vibrates about its mean deflection.",
    module="gallery/cases/slewing.py",
)
