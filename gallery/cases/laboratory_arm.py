"""State feedback of a flexible arm of a students' laboratory, driven by the voltage of a motor."""

from __future__ import annotations

import warnings
from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import BLUE, INK, VERMILLION, legend_above
from gallery.case import Case, Row
from gallery.drawing import OURS
from gallery.references import reference
from gallery.state_feedback import StateFeedback

if TYPE_CHECKING:
    import xarray as xr

KNOWN = reference("control", "laboratory")
NUMBERS = KNOWN.values
LENGTH = NUMBERS["length"]
#: Sample time of the loop, rate of the result.
SAMPLE_TIME, RATE = 0.001, 1000.0
#: Runs that are repeated with the ruler as a beam.
BENT = (0, 5)

PHYSICS = r"""
A motor with a gear turns a ruler of 0.45 m and 60 g with 50 g at its tip. The voltage of the motor
is $K_1(\theta_d - \theta) - K_3\dot\theta - K_2 d - K_4\dot d$ with the angle $\theta$ of the hub
and the deflection $d$ of the tip from it. The students' task: reach the goal within 1 s, and
deflect little. The script prints, for eight sets of gains, when its simulation comes within 5 % of
the goal, and how far the tip deflects.

The model of the script is linear: a rigid bar on a torsion spring, with the measured frequency of
1.8 Hz with the hub locked. In the package this is a joint with `rotor_inertia`, `stiffness` and
`fa.Winding` and a link with `flexible=False`, and the controller is sampled. The last rows have
a beam with the same frequency in place of the bar. Its tip is softer, 8.2 N/m and not 9.0:
33/140 of the mass of a beam moves with its tip, and a third of that of a bar. So it deflects more.

The package: `fa.simulate` with a controller of one's own and `fa.Instrument`.
"""


def _joint(**spring: float) -> fa.Joint:
    motor = {name: NUMBERS[name] for name in ("torque_constant", "resistance")}
    ratio = NUMBERS["gear_ratio"]
    inertia = NUMBERS["hub_inertia"] / ratio**2
    return fa.Joint(rotor_inertia=inertia, gear_ratio=ratio, winding=fa.Winding(**motor), **spring)


def bar() -> fa.Arm:
    """The rigid bar on a spring, the model of the script."""
    mass = NUMBERS["bar_mass"]
    inertia = (mass / 3 + NUMBERS["tip_mass"]) * LENGTH**2
    stiffness = (2 * np.pi * NUMBERS["locked_hz"]) ** 2 * inertia
    link = fa.Link(length=LENGTH, mass_per_length=mass / LENGTH, flexible=False)
    payload = fa.Payload(mass=NUMBERS["tip_mass"])
    return fa.Arm(links=[link], joints=[_joint(stiffness=stiffness)], payload=payload)


def beam() -> fa.Arm:
    """The ruler as a beam with the same frequency."""

    def arm(rigidity: float) -> fa.Arm:
        link = fa.Link(
            length=LENGTH,
            mass_per_length=NUMBERS["bar_mass"] / LENGTH,
            flexural_rigidity=rigidity,
            elements=4,
            modes=2,
        )
        return fa.Arm(links=[link], joints=[_joint()], payload=fa.Payload(mass=NUMBERS["tip_mass"]))

    unit = float(fa.modes(arm(1.0), joints="locked").frequency_hz[0])
    return arm((NUMBERS["locked_hz"] / unit) ** 2)


@cache
def run(number: int, bends: bool = False) -> xr.Dataset:
    """A step of 1 rad with one set of gains."""
    arm = beam() if bends else bar()
    per_volt = arm.joints[0].torque_per_voltage
    K1, K2, K3, K4 = (per_volt * gain for gain in NUMBERS["runs"][number]["gains"])
    if bends:
        signals = ("joint_angle", "joint_rate", "link_tip_deflection", "link_tip_deflection_rate")
        gains = (K1, K3, K2, K4)
    else:  # the deflection is the length times the twist of the spring
        signals = ("joint_angle", "joint_rate", "link_angle", "link_rate")
        gains = (K1 - LENGTH * K2, K3 - LENGTH * K4, LENGTH * K2, LENGTH * K4)
    with warnings.catch_warnings():  # the script is linear, and so is this beam
        warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
        return StateFeedback(signals, gains, K1, SAMPLE_TIME).run(arm, 1.2, RATE)


def histories(number: int, bends: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times (s), hub angle (rad) and tip deflection (cm)."""
    result = run(number, bends)
    name, factor = ("link_tip_deflection", 1.0) if bends else ("joint_twist", LENGTH)
    deflection = 100 * factor * result[name].values[:, 0]
    return result.time.values, result.joint_angle.values[:, 0], deflection


def quantities() -> list[Row]:
    printed = "the law of the script is continuous, this one is sampled every millisecond"
    bent = "the script has a rigid bar on a spring, here the ruler is a beam"
    rows = []
    chosen = [(k, False) for k in range(len(NUMBERS["runs"]))] + [(k, True) for k in BENT]
    for number, bends in chosen:
        known = NUMBERS["runs"][number]
        t, angle, deflection = histories(number, bends)
        name = ", ".join(f"{gain:g}" for gain in known["gains"])
        name = f"{'beam, ' if bends else ''}gains {name}"
        arrival = float(t[np.argmax(np.abs(angle - 1.0) < 0.05)])
        largest = float(np.max(np.abs(deflection)))
        reason = bent if bends else printed
        digits = (1.2, 1.2) if bends else (2.4, 2.0)
        theirs = known["deflection"]
        quantity = f"{name}, largest deflection"
        rows.append(Row(quantity, "cm", KNOWN.source, theirs, largest, digits[0], reason))
        quantity = f"{name}, within 5 % after"
        rows.append(Row(quantity, "s", KNOWN.source, known["time"], arrival, digits[1], reason))
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2)
    for number, colour in zip(BENT, (BLUE, VERMILLION), strict=True):
        known = NUMBERS["runs"][number]
        label = f"$K_1$ = {known['gains'][0]:g}"
        t, angle, deflection = histories(number)
        left.plot(t, angle, color=colour, label=label)
        left.plot(known["time"], 0.95, **OURS, color=INK)
        right.plot(t, deflection, color=colour)
        t, angle, deflection = histories(number, bends=True)
        left.plot(t, angle, color=colour, linestyle=(0, (4, 2)), linewidth=0.9)
        right.plot(t, deflection, color=colour, linestyle=(0, (4, 2)), linewidth=0.9)
        right.axhline(-known["deflection"], color=INK, linewidth=0.6, linestyle=":")
    left.axhline(0.95, color=INK, linewidth=0.6, linestyle=":")
    left.set(xlabel="time [s]", ylabel="hub angle [rad]", xlim=(0, 1.2), ylim=(0, 1.1))
    right.set(xlabel="time [s]", ylabel="tip deflection [cm]", xlim=(0, 1.2))
    left.set_title("Hub")
    right.set_title("Tip")
    legend_above(left)


CASE = Case(
    name="laboratory-arm",
    title="Laboratory arm with state feedback",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Two of the eight sets of gains; dashed, with the ruler as a beam. Points and dotted "
    "lines: the printed times and deflections.",
    module="gallery/cases/laboratory_arm.py",
)
