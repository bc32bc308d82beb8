"""Spin-up of a beam: the classic trial of theories of flexible links."""

from __future__ import annotations

import math
import warnings
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREEN, INK, VERMILLION, legend_above
from gallery.beam import FloatArray
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

RAMP, SPIN = 15.0, 6.0  # s, rad/s
HUB = 1e12  # kg m^2
#: Of each theory: fields of the link, name of the arm's theory, duration (s).
MODELS: dict[str, tuple[dict[str, Any], str, float]] = {
    "softened": ({"elements": 16}, "linear", 10.0),
    "stiffened": ({"elements": 24, "modes": 12}, "second_order", 30.0),
    "elastica": ({"elements": 16, "segments": 8, "modes": 3}, "second_order", 12.0),
}
LABELS = {"softened": "linear", "stiffened": "second order", "elastica": "8 segments"}

PHYSICS = r"""
A 10 m beam ($EI = 1.4\cdot10^4$ N m², $\mu = 1.2$ kg/m) is spun up to 6 rad/s in 15 s,

$$ \theta(t) = \tfrac{6}{15}\left[\tfrac{t^2}{2}
+ \left(\tfrac{15}{2\pi}\right)^2\left(\cos\tfrac{2\pi t}{15} - 1\right)\right],
\qquad t < 15\ \text{s}. $$

Kane, Ryan and Banerjee used this problem in 1987 to show that the multibody programs of that time
were wrong: without rotational stiffening the beam diverges, because 6 rad/s is beyond its first
frequency, 3.80 rad/s. The paper's theory is of this kind, and `theory="linear"` reproduces it.
With foreshortening the tip lags by 0.57 m, returns, and vibrates with 4 mm.

There are three references: the linear beam with centrifugal stiffness (`theory="second_order"`,
one segment), the geometrically exact beam (segments), and the linear beam without centrifugal
stiffness.

The package: the motor drives the joint. The hub has an inertia of $10^{12}$ kg m², and the torque
is this inertia times $\ddot\theta$. The reaction of the beam is $10^{-9}$ of the torque and
disturbs the angle by less than a tenth of a microradian.
"""


def acceleration(t: float) -> float:
    """Prescribed angular acceleration (rad/s^2)."""
    return SPIN / RAMP * (1 - math.cos(2 * math.pi * t / RAMP)) if t < RAMP else 0.0


def _torque(t: float) -> list[float]:
    return [HUB * acceleration(t)]


@cache
def run(model: str) -> xr.Dataset:
    """Simulate one of the models."""
    link, theory, duration = MODELS[model]
    beam = fa.Link(length=10.0, flexural_rigidity=1.4e4, mass_per_length=1.2, **link)
    arm = fa.Arm(links=[beam], joints=[fa.Joint(hub_inertia=HUB)], theory=theory)
    with warnings.catch_warnings():  # how far the linear theory goes astray is what we are after
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        return fa.simulate(arm, duration, torque=_torque, rtol=1e-10, atol=1e-12)


def deflection(model: str) -> tuple[FloatArray, FloatArray]:
    """Times (s) and tip deflections from the root tangent (m)."""
    result = run(model)
    return result.time.values, result.link_tip_deflection.values[:, 0]


def summary(model: str) -> dict[str, float]:
    """The quantities that are known, as the package computes them."""
    t, v = deflection(model)
    curve = CubicSpline(t, v)
    found = {name: float(curve(at)) for name, at in (("v5", 5.0), ("v75", 7.5), ("v10", 10.0))}
    if model != "softened":
        turns = curve.derivative().roots(extrapolate=False)
        found["extreme_time"] = float(min(turns, key=curve))
        found["extreme"] = float(curve(found["extreme_time"]))
    if t[-1] > RAMP:
        found["residual"] = float(np.max(np.abs(v[t > RAMP])))
    return found


NAMES = {
    "extreme": ("largest tip deflection", "m"),
    "extreme_time": ("time of the largest deflection", "s"),
    "v5": ("tip deflection at 5 s", "m"),
    "v75": ("tip deflection at 7.5 s", "m"),
    "v10": ("tip deflection at 10 s", "m"),
    "residual": ("amplitude after 15 s", "m"),
}
#: Digits required: the vibration's phase drifts, so later values have fewer.
DIGITS = {
    "stiffened": {"extreme": 3.3, "extreme_time": 3.6, "v5": 3.6, "v75": 3.4, "v10": 3.4},
    "softened": {"v5": 7.3, "v75": 6.3, "v10": 5.7},
    "elastica": {"extreme": 4.6, "extreme_time": 5.0, "v5": 4.9, "v75": 4.6},
}
REASONS = {
    "stiffened": "the reference is linear in the deflection; flexarm keeps terms of third order, "
    "which make its mass matrix positive definite",
    "softened": "16 elements; their error grows with time, and at 10 s the whole solution diverges",
    "elastica": "8 segments; the error decreases as the cube of their length",
}
RESIDUAL = (
    1.8,
    "as for the other numbers of this theory; the residual is a small part of the motion",
)


def quantities() -> list[Row]:
    rows = []
    for model in ("stiffened", "softened", "elastica"):
        known, found = reference("spin_up", model), summary(model)
        for key, value in known.values.items():
            name, unit = NAMES[key]
            digits, reason = DIGITS[model].get(key, RESIDUAL[0]), REASONS[model]
            if key == "residual":
                reason = RESIDUAL[1]
            quantity = f"{LABELS[model]}, {name}"
            rows.append(Row(quantity, unit, known.source, value, found[key], digits, reason))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1.0])
    colours = {"softened": VERMILLION, "stiffened": BLUE, "elastica": GREEN}
    for model in ("softened", "stiffened"):
        t, v = deflection(model)
        left.plot(t, v, color=colours[model], label=LABELS[model])
    known = reference("spin_up", "stiffened").values
    points = [(5.0, known["v5"]), (7.5, known["v75"]), (10.0, known["v10"])]
    points.append((known["extreme_time"], known["extreme"]))
    x, y = zip(*points, strict=True)
    left.plot(x, y, **OURS, color=INK, label="known")
    left.annotate("diverges", (6.85, -0.83), fontsize=8, color=VERMILLION)
    left.set(xlabel="time [s]", ylabel="tip deflection [m]", xlim=(0, 20), ylim=(-0.9, 0.05))
    left.set_title("Deflection")
    legend_above(left)
    for model in ("stiffened", "elastica"):
        t, v = deflection(model)
        near = (t > 6.2) & (t < 7.4)
        right.plot(t[near], 1e3 * v[near], color=colours[model], label=LABELS[model])
        values = reference("spin_up", model).values
        right.plot(values["extreme_time"], 1e3 * values["extreme"], **OURS, color=INK)
    right.set(xlabel="time [s]", ylabel="tip deflection [mm]")
    right.set_yticks([-575, -570, -565, -560])
    right.set_title("Turning point")
    label_lines(right)


CASE = Case(
    name="spin-up",
    title="Spin-up",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: without centrifugal stiffness the beam diverges; with it, it lags and "
    "recovers. Right: the turning point, where the geometrically exact beam differs by "
    "0.6 mm. Points: reference values.",
    module="gallery/cases/spin_up.py",
)
