"""A pendulum on a cart, rigid and flexible: a base that moves."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row, distance_digits
from gallery.drawing import OURS, logarithmic_ticks
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

LENGTH, GRAVITY = 1.0, 9.81
RIGID_CART, CART = 2.0, 0.1  # kg
SEGMENTS = (1, 2, 4, 8)
FINEST = 8
ACCEPTED = 4e-6  # m
RATE = 500.0
RIGID_REASON = "the tolerance of the integrator, rtol = 1e-10"
REASON = (
    f"within {ACCEPTED:g} m: {FINEST} segments of two elements, and 2e-6 m of the reference itself"
)

PHYSICS = r"""
A rod hangs from a cart that moves on a horizontal rail without friction. It is released horizontal
and at rest. The centre of mass of rod and cart moves vertically only.

- *Rigid rod*: conservation of horizontal momentum gives the place of the cart, and the energy
  equation of the angle gives the time until the rod is horizontal again, on the other side.
- *Flexible rod*, that of the falling flexible pendulum, on a light cart: the reference is the
  geometrically exact, inextensible and unshearable beam whose root carries the mass of the cart.

The package: `fa.Base(mass=..., free=("x",))`; the flexible rod has the second-order theory and
`segments=k` of two elements each.
"""


@cache
def rigid() -> xr.Dataset:
    """Simulate the rigid rod on a cart until it is horizontal again."""
    rod = fa.Link(length=LENGTH, mass_per_length=1.0, flexible=False)
    base = fa.Base(mass=RIGID_CART, free=("x",))
    arm = fa.Arm(links=[rod], base=base, gravity=(0.0, -GRAVITY))
    duration = reference("mechanisms", "cart").values["time"]
    return fa.simulate(arm, duration, rate=100.0 / duration, rtol=1e-10, atol=1e-12)


@cache
def run(segments: int) -> tuple[fa.Arm, xr.Dataset]:
    """Let go the flexible rod of a number of segments."""
    link = fa.Link(
        length=LENGTH,
        flexural_rigidity=2.0,
        mass_per_length=0.2,
        elements=2 * segments,
        segments=segments,
        modes=3 if segments > 1 else 2,
    )
    base = fa.Base(mass=CART, free=("x",))
    arm = fa.Arm(links=[link], base=base, gravity=(0.0, -GRAVITY), theory="second_order")
    return arm, fa.simulate(arm, 0.8, rate=RATE, rtol=1e-8, atol=1e-10)


def places(segments: int) -> FloatArray:
    """Tip (x, y) and cart x at the times of the reference, (times, 3)."""
    times = [case["t"] for case in reference("mechanisms", "flexible_cart").values]
    sampled = run(segments)[1].sel(time=times, method="nearest")
    return np.column_stack([sampled.tip.values, sampled.q.values[:, 0]])


def known_places() -> FloatArray:
    """The same of the reference."""
    known = reference("mechanisms", "flexible_cart").values
    return np.array([[*case["tip"], case["cart"]] for case in known])


def quantities() -> list[Row]:
    known = reference("mechanisms", "cart")
    end = rigid().isel(time=-1)
    angle, place = float(end.joint_angle.values[0]), float(end.q.values[0])
    rows = [
        Row("rigid, angle after the swing", "rad", known.source, -np.pi, angle, 9.5, RIGID_REASON),
        Row(
            "rigid, cart after the swing",
            "m",
            known.source,
            known.values["displacement"],
            place,
            9.5,
            RIGID_REASON,
        ),
    ]
    exact = reference("mechanisms", "flexible_cart")
    digits = distance_digits(ACCEPTED, LENGTH)
    for case, theirs, ours in zip(exact.values, known_places(), places(FINEST), strict=True):
        for name, known_value, found in zip(
            ("tip x", "tip y", "cart x"), theirs, ours, strict=True
        ):
            rows.append(
                Row(
                    f"flexible, {name} at {case['t']:g} s",
                    "m",
                    exact.source,
                    float(known_value),
                    float(found),
                    digits,
                    REASON,
                    scale=LENGTH,
                )
            )
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
    arm, result = run(FINEST)
    left.axhline(0.0, color=GREY, linewidth=0.7)
    left.plot(*result.tip.values.T, color=GREY, linewidth=0.8)
    for q in result.q.values[:: round(0.05 * RATE)]:
        left.plot(*np.asarray(arm.shape(q, stations=41)[0]).T, color=BLUE, linewidth=1.0)
        left.plot(q[0], 0.0, "s", color=VERMILLION, markersize=3)
    left.plot(*known_places()[:, :2].T, **OURS, color=INK)
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    left.set_title("Motion")
    left.grid(False)
    worst = [np.max(np.abs(places(k) - known_places())) for k in SEGMENTS]
    right.plot(SEGMENTS, worst, "o-", color=BLUE, markersize=3.6)
    right.axhline(2e-6, color=GREY, linewidth=0.7, linestyle=(0, (4, 2)))
    right.text(1, 2.3e-6, "certainty of the reference", fontsize=8, color=GREY)
    right.set(xlabel="segments", ylabel="largest error [m]", yscale="log")
    logarithmic_ticks(right, SEGMENTS)
    right.margins(x=0.06)
    right.set_title("Error")


CASE = Case(
    name="cart",
    title="Pendulum on a cart",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: flexible rod and cart (squares) every 50 ms; points are tips of the exact beam. "
    "Right: error of tip and cart against the number of segments.",
    module="gallery/cases/cart.py",
)
