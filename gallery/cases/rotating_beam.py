"""Frequencies of a beam that turns at a steady rate: where theories of flexible links part."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import eigh
from scipy.optimize import brentq

from flexarm.view.plot.style import BLUE, GREEN, INK, VERMILLION, legend_above
from gallery.beam import FloatArray, unit_beam
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.line_labels import label_lines
from gallery.references import reference

ELEMENTS, ELEMENTS_OF_CURVES = 64, 16
REASON = (
    f"a mesh of {ELEMENTS} elements, and rounding of 1e-9; at high speed the beam behaves like a"
    " string with a thin bending layer at the root, which needs a finer mesh: 1e-7 at γ = 12"
)
HUB_REASON = REASON.replace("1e-7 at γ = 12", "4e-7 at γ = 12 and δ = 2")
LINEAR_REASON = (
    f"exact for any mesh except for the frequency at rest, which {ELEMENTS} elements give to "
    "(βh)⁴/1440, and rounding of 1e-9"
)

PHYSICS = r"""
A beam is clamped to a hub of radius $\delta L$ that rotates at the steady rate $\Omega$;
$\gamma = \Omega L^2\sqrt{\mu/EI}$. Centrifugal tension stiffens it. In the plane of rotation the
centrifugal force also follows the deflection, which subtracts $\gamma^2$ from the squared
frequency: $\lambda_\text{lag}^2 = \lambda_\text{flap}^2 - \gamma^2$. A planar arm vibrates in
this plane (*lag*).

A theory without foreshortening, such as the paper's (`theory="linear"`), has the second effect
but not the first. Its beam softens, $\lambda^2 = \lambda_0^2 - \gamma^2$, and at $\gamma = 3.516$
the stiffness is zero. The package must reproduce this result of the theory, although it is
physically wrong. **Use `theory="second_order"` for links that rotate fast.**

The package: `arm.derivatives(q, qd, torque)` at the straight arm with the joint rotating at
$\Omega$ gives the Jacobian of the accelerations. With the mass matrix, its elastic block is the
stiffness for a prescribed rate of the joint. The hub is the `hub_radius` of the link.
"""


@cache
def squared(gamma: float, theory: str, elements: int = ELEMENTS, radius: float = 0.0) -> FloatArray:
    """Squared frequencies (count,) of the beam that turns at gamma, ascending."""
    arm = unit_beam(elements, theory=theory, hub_radius=radius)
    q, qd = arm.rest([0.0]), np.zeros(arm.dof)
    qd[arm.joint_index] = gamma
    # Steady rotation needs no torque: all accelerations are zero, and M is not differentiated.
    M = arm.mass_matrix(q)
    stiffness = -(M @ arm.derivatives(q, qd, [0.0]).q)[1:, 1:]
    symmetric = (stiffness + stiffness.T) / 2
    shift = gamma**2 + 10.0  # makes the softened stiffness positive definite
    inverse = eigh(M[1:, 1:], symmetric + shift * M[1:, 1:], eigvals_only=True)[::-1]
    return np.asarray(1.0 / inverse - shift)


def critical_speed() -> float:
    """Speed at which the linear theory's beam loses its stiffness."""
    return float(brentq(lambda gamma: squared(gamma, "linear")[0], 3.4, 3.6, xtol=1e-13))


def quantities() -> list[Row]:
    lag, flap = reference("rotating", "lag"), reference("rotating", "flap")
    at_rest = reference("beams", "clamped")
    rows = []
    for case in lag.values:
        gamma = case["gamma"]
        for k in range(3 if gamma in (2.0, 12.0) else 1):
            found = float(np.sqrt(squared(gamma, "second_order")[k]))
            digits = (8.0, 7.2, 6.6)[k] if gamma < 6 else (6.8, 7.2, 6.6)[k]
            name = f"γ = {gamma:g}, λ of lag mode {k + 1}"
            rows.append(Row(name, "1", lag.source, case["lambda"][k], found, digits, REASON))
    for case in flap.values:
        if case["gamma"] in (6.0, 12.0):
            found = float(np.sqrt(squared(case["gamma"], "second_order")[0] + case["gamma"] ** 2))
            name = f"γ = {case['gamma']:g}, λ of flap mode 1, from lag"
            rows.append(Row(name, "1", flap.source, case["lambda"][0], found, 7.2, REASON))
    hub = reference("rotating", "hub_radius")
    for case in hub.values:
        gamma, radius = case["gamma"], case["radius"]
        for k in range(3 if gamma == 12.0 else 1):
            found = float(np.sqrt(squared(gamma, "second_order", radius=radius)[k]))
            name = f"δ = {radius:g}, γ = {gamma:g}, λ of lag mode {k + 1}"
            rows.append(Row(name, "1", hub.source, case["lambda"][k], found, 6.4, HUB_REASON))
    first = at_rest.values["lambda"][0]
    for gamma in (2.0, 3.0):
        exact = float(np.sqrt(first**2 - gamma**2))
        found = float(np.sqrt(squared(gamma, "linear")[0]))
        name = f"γ = {gamma:g}, λ of mode 1 in the linear theory"
        rows.append(Row(name, "1", at_rest.source, exact, found, 8.3, LINEAR_REASON))
    name = "γ at which the linear theory loses all stiffness"
    rows.append(Row(name, "1", at_rest.source, first, critical_speed(), 9.0, LINEAR_REASON))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    gammas = np.linspace(0, 12, 49)
    lag = reference("rotating", "lag").values
    second = np.array([squared(float(g), "second_order", ELEMENTS_OF_CURVES)[:3] for g in gammas])
    linear = np.array([squared(float(g), "linear", ELEMENTS_OF_CURVES)[0] for g in gammas])
    left.plot(gammas, second[:, 0], color=BLUE, label="second order")
    left.plot(gammas, linear, color=VERMILLION, label="linear")
    exact = [case["lambda"][0] ** 2 for case in lag]
    left.plot([case["gamma"] for case in lag], exact, **OURS, color=INK, label="known")
    left.axhline(0, color=INK, linewidth=0.6)
    left.annotate(
        "no stiffness left:\n$\\gamma = 3.516$",
        (3.516, 0),
        (0.2, -31),
        arrowprops={"arrowstyle": "-", "color": INK, "linewidth": 0.6},
        fontsize=8,
    )
    left.set(xlabel="speed $\\gamma$", ylabel="squared frequency $\\lambda_1^2$", ylim=(-45, 45))
    left.set_title("Theories")
    legend_above(left)
    speeds = gammas[::2]
    for radius, colour in ((2.0, GREEN), (0.5, VERMILLION), (0.0, BLUE)):
        curve = [squared(float(g), "second_order", 16, radius)[0] ** 0.5 for g in speeds]
        right.plot(speeds, curve, color=colour, label=f"$\\delta$ = {radius:g}")
    known = reference("rotating", "hub_radius").values
    right.plot([c["gamma"] for c in known], [c["lambda"][0] for c in known], **OURS, color=INK)
    right.set(xlabel="speed $\\gamma$", ylabel="$\\lambda_1$")
    right.set_title("Radius of the hub")
    for axes in (left, right):
        axes.margins(x=0.02)
    label_lines(right)


CASE = Case(
    name="rotating-beam",
    title="Rotating beam",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the first frequency in the plane of rotation increases slowly with speed; "
    "without foreshortening it decreases to zero and the beam diverges. Right: hubs of "
    "several radii, second-order theory. Points: reference values.",
    module="gallery/cases/rotating_beam.py",
)
