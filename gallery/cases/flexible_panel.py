"""A body that turns a flexible panel: state feedback and two nested loops of a textbook."""

from __future__ import annotations

import warnings
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import place_poles

import flexarm as fa
from flexarm.view.plot.style import BLUE, GREY, INK, VERMILLION, legend_above
from gallery.beam import FloatArray
from gallery.case import Case, Row, rounding_digits
from gallery.references import reference
from gallery.state_feedback import StateFeedback

if TYPE_CHECKING:
    import xarray as xr

STATE, CASCADE = reference("control", "panel_state"), reference("control", "panel_cascade")
SIGNALS = ("joint_angle", "link_angle", "joint_rate", "link_rate")

PHYSICS = r"""
A motor torque $\tau$ turns a body of inertia 5; a spring with damping carries a panel of inertia 1.
The angle $\varphi$ of the panel shall follow a reference; body and panel are measured. It is the
satellite of a textbook, and the same problem as an arm with an elastic joint. Two of its
controllers are printed with their numbers:

- *State feedback*, $\tau = k_r\varphi_r - K(\theta, \varphi, \dot\theta, \dot\varphi)$, with
  prescribed poles.
- *Nested loops*: the outer loop $\theta_r = k_P(\varphi_r - \varphi) - k_D\dot\varphi$ commands the
  inner one, a PD law of the body. The panel stops short of its reference, at a steady gain that is
  printed.

State feedback agrees to five or six digits. With the nested loops, the slow pair of poles of the
whole arm has a frequency of 0.44 rad/s and a damping ratio of 0.35. The text requests 0.22 rad/s
and 0.9: its linear equations for the gains have $J_p b$ where its polynomial has $b\,\omega^2$,
and were solved for a ratio of 0.707.

The package: `fa.linearize` with the outputs that are fed back, `fa.simulate` with a controller of
one's own. The joint has `rotor_inertia`, `stiffness` and `damping`; the link has `flexible=False`.
"""


def arm(numbers: dict[str, float]) -> fa.Arm:
    """Body and panel: rotor of an elastic joint, and a rigid rod of 1 m about it."""
    rod = fa.Link(length=1.0, mass_per_length=3.0 * numbers["panel"], flexible=False)
    spring = {name: numbers[name] for name in ("stiffness", "damping")}
    with warnings.catch_warnings():  # no arm on earth has such a soft spring
        warnings.simplefilter("ignore", fa.ImplausibleValueWarning)
        return fa.Arm(links=[rod], joints=[fa.Joint(rotor_inertia=numbers["body"], **spring)])


def model(numbers: dict[str, float]) -> tuple[FloatArray, FloatArray]:
    """A (4, 4) and B (4, 1) for the states that are fed back."""
    linear = fa.linearize(arm(numbers), outputs=list(SIGNALS))
    back = np.linalg.inv(linear.C)
    return linear.C @ linear.A @ back, linear.C @ linear.B


def steady_gain(A: FloatArray, B: FloatArray, gains: FloatArray) -> float:
    """Steady panel angle per constant torque that is added to the feedback (rad/(N m))."""
    return -float(np.linalg.solve(A - B @ gains[None, :], B)[1, 0])


def cascade_gains() -> tuple[FloatArray, float]:
    """Gains of the nested loops on the four states, and on the reference."""
    (kp, kd), (outer_kp, outer_kd) = CASCADE.values["inner"], CASCADE.values["outer"]
    return np.array([kp, kp * outer_kp, kd, kp * outer_kd]), kp * outer_kp


@cache
def runs() -> dict[str, xr.Dataset]:
    """A step of 0.2 rad of the reference, with both controllers."""
    gains, reference_gain = cascade_gains()
    laws = {
        "state feedback": (STATE, np.array(STATE.values["gains"]), STATE.values["reference_gain"]),
        "nested loops": (CASCADE, gains, reference_gain),
    }
    return {
        name: StateFeedback(SIGNALS, law, 0.2 * per_reference, 0.02).run(
            arm(known.values), 90.0, 20.0
        )
        for name, (known, law, per_reference) in laws.items()
    }


def quantities() -> list[Row]:
    known = STATE.values
    A, B = model(known)
    printed = np.array(known["gains"])
    rounding = "half a unit of the last printed digit"
    rows = []
    for name, theirs, matrix in (
        ("open loop", known["open"], A),
        ("closed loop", known["closed"], A - B @ printed[None, :]),
    ):
        for power, value, ours in zip((3, 2, 1, 0), theirs, np.poly(matrix)[1:], strict=True):
            if value:
                digits = rounding_digits(value, 4) - 0.4
                reason = "the last printed digit, and the printed gains"
                quantity = f"{name}, coefficient of s^{power}"
                rows.append(Row(quantity, "1", STATE.source, value, float(ours), digits, reason))
    poles = np.roots([1.0, *known["closed"]])
    gains = place_poles(A, B, poles).gain_matrix[0]
    for name, value, ours in zip(
        ("hub", "panel", "hub rate", "panel rate"), printed, gains, strict=True
    ):
        reason = "poles from coefficients with four decimals"
        rows.append(
            Row(f"gain on {name}", "1", STATE.source, float(value), float(ours), 5.0, reason)
        )
    ours = 1.0 / steady_gain(A, B, printed)
    theirs = known["reference_gain"]
    digits = rounding_digits(theirs, 4) - 0.4
    rows.append(Row("gain on reference", "1", STATE.source, theirs, ours, digits, rounding))
    settled = float(runs()["nested loops"].link_angle.values[-1, 0]) / 0.2
    theirs = CASCADE.values["steady"]
    digits = rounding_digits(theirs, 4)
    quantity = "nested loops, panel angle over reference after 90 s"
    rows.append(Row(quantity, "1", CASCADE.source, theirs, settled, digits, rounding))
    return rows


def draw(figure: Figure) -> None:
    axes = figure.subplots()
    for (name, result), colour in zip(runs().items(), (BLUE, VERMILLION), strict=True):
        t = result.time.values
        axes.plot(t, result.link_angle.values[:, 0], color=colour, label=f"{name}, panel")
        axes.plot(t, result.joint_angle.values[:, 0], color=colour, linewidth=0.7, alpha=0.6)
    axes.axhline(0.2, color=GREY, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.axhline(0.2 * CASCADE.values["steady"], color=INK, linewidth=0.6, linestyle=":")
    axes.set(xlabel="time [s]", ylabel="angle [rad]", xlim=(0, 30))
    axes.set_title("Body with a flexible panel, step of 0.2 rad")
    legend_above(axes)


CASE = Case(
    name="flexible-panel",
    title="Body with a flexible panel",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Panel, and as thin lines the body. Dotted: the printed steady gain of the nested "
    "loops, which stop there.",
    module="gallery/cases/flexible_panel.py",
)
