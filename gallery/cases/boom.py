"""A five-link boom under gravity: holding torques, and the energy balance of a lift."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

import flexarm as fa
from flexarm.view.plot.style import FLEXIBLE, INK, RIGID, SERIES, VERMILLION
from gallery.beam import FloatArray
from gallery.case import Case, Row
from gallery.references import reference

if TYPE_CHECKING:
    import xarray as xr

GRAVITY = 9.81
LENGTHS = (8.0, 7.0, 7.0, 6.0, 5.0)  # m
BOXES = (  # width, height, wall, m
    (0.40, 0.50, 0.010),
    (0.34, 0.42, 0.008),
    (0.30, 0.36, 0.008),
    (0.25, 0.30, 0.006),
    (0.20, 0.24, 0.006),
)
MOTORS = (0.0, 180.0, 140.0, 110.0, 80.0)  # kg
#: Inertia of each drive, seen from its link and from the link before (kg m^2).
DRIVES = (8000.0, 5500.0, 2500.0, 700.0, 100.0)
PAYLOAD = 120.0  # kg
DENSITY = 7850.0  # kg/m^3, steel

START = np.radians([25.0, -10.0, -30.0, -40.0, -20.0])
END = np.radians([75.0, -20.0, -30.0, -45.0, -40.0])
LIFT, DURATION, SAMPLE = 8.0, 10.0, 0.002  # s
BANDWIDTH = 2.0  # rad/s

RIGID_REASON = "a sum of weights times lever arms: only rounding errors"
BENT_REASON = "Simpson's rule is exact for the cubic shapes of the elements: only rounding errors"
ENERGY_REASON = "the tolerance of the integrator, rtol = 1e-8, over 10 s"

PHYSICS = r"""
A folded boom of five steel boxes, 33 m in all, with motors in its joints and 120 kg at the tip:
the arm of a concrete pump. It weighs 3.5 t, its tip sags by 0.7 m, and its first frequency is
0.65 Hz.

- *Rigid*, at rest: each joint carries the moment of everything outboard, a sum of weights times
  lever arms.
- *Bent*, at rest: the same balance over the bent shape, with the moment integrated along it. The
  shape comes from the equilibrium. The balance of its torques and weights is an independent check.
- *The lift*: a joint controller raises the boom in 8 s, and the boom vibrates. Torques are
  constant between samples, so the work of the motors is the sum of torque times change of
  *relative* joint angle. It must equal the change of kinetic, strain and gravity energy.

The package: `arm.rigid()`, `fa.equilibrium`, `fa.simulate` with `fa.JointPD`.
"""


@cache
def boom() -> fa.Arm:
    """The flexible boom."""
    links = [
        fa.Link(
            length=length,
            material="steel",
            section=fa.Box(width=width, height=height, thickness=wall),
            elements=4,
            modes=4,
        )
        for length, (width, height, wall) in zip(LENGTHS, BOXES, strict=True)
    ]
    joints = [
        fa.Joint(hub_inertia=drive, housing_inertia=drive, mass=motor)
        for drive, motor in zip(DRIVES, MOTORS, strict=True)
    ]
    return fa.Arm(
        links=links, joints=joints, payload=fa.Payload(mass=PAYLOAD), gravity=(0.0, -GRAVITY)
    )


def masses_per_length() -> FloatArray:
    """Of each link, from its box (kg/m)."""
    return np.array([DENSITY * (w * h - (w - 2 * t) * (h - 2 * t)) for w, h, t in BOXES])


def holding_torques(shape: FloatArray) -> FloatArray:
    """Moment of all outboard weights about each joint (5,), from the shape of the axis.

    Args:
        shape: (links, points, 2) m, an odd number of points evenly along each link.
    """
    points = shape.shape[1]
    simpson = np.ones(points)
    simpson[1:-1:2], simpson[2:-1:2] = 4.0, 2.0
    weights = np.outer(masses_per_length() * LENGTHS, simpson / simpson.sum())
    x = shape[:, :, 0]
    torques = np.zeros(len(LENGTHS))
    for joint in range(len(LENGTHS)):
        lever = x[joint:] - x[joint, 0]
        own = np.sum(weights[joint:] * lever)
        # A motor hangs on the tip of the link before its joint.
        motors = sum(MOTORS[i] * (x[i, 0] - x[joint, 0]) for i in range(joint + 1, len(LENGTHS)))
        payload = PAYLOAD * (x[-1, -1] - x[joint, 0])
        torques[joint] = GRAVITY * (own + motors + payload)
    return torques


@cache
def lift() -> xr.Dataset:
    """The boom on its way up."""
    arm = boom()
    motion = fa.joint_motion(arm, START, END, LIFT)
    inertia = np.diag(arm.rigid().mass_matrix(END))
    controller = fa.JointPD(
        proportional=BANDWIDTH**2 * inertia,
        derivative=1.6 * BANDWIDTH * inertia,
        sample_time=SAMPLE,
        feedforward=fa.rigid_torque(arm, motion),
    )
    start = fa.equilibrium(arm, START).q
    return fa.simulate(
        arm,
        DURATION,
        controller=controller,
        reference=motion,
        initial=start,
        rate=1 / SAMPLE,
        rtol=1e-8,
    )


def work_and_energy() -> tuple[FloatArray, FloatArray]:
    """Work of the motors and gain of energy since the start, (samples,) J."""
    result = lift()
    turned = np.diff(result.joint_angle.values, axis=0)
    work = np.cumsum(np.sum(result.torque.values[:-1] * turned, axis=1))
    energy = (result.kinetic_energy + result.strain_energy + result.gravity_energy).values
    return np.append(0.0, work), energy - energy[0]


def quantities() -> list[Row]:
    sums, energy = (reference("boom", name).source for name in ("holding", "energy"))
    arm = boom()
    still = np.zeros(arm.n_joints)
    rigid = arm.rigid()
    rest = fa.equilibrium(arm, START)
    rows = []
    for name, theirs, ours, digits, reason in (
        (
            "rigid",
            holding_torques(rigid.shape(START, stations=3)),
            rigid.inverse_dynamics(START, still, still),
            13.0,
            RIGID_REASON,
        ),
        ("bent", holding_torques(arm.shape(rest.q, 401)), rest.torque, 13.0, BENT_REASON),
    ):
        rows += [
            Row(f"{name}, torque of joint {i + 1}", "N m", sums, float(a), float(b), digits, reason)
            for i, (a, b) in enumerate(zip(theirs, ours, strict=True))
        ]
    work, gained = work_and_energy()
    scale = float(np.max(np.abs(work)))
    for name, theirs, ours in (
        ("energy gained", work[-1], gained[-1]),
        ("largest difference of energy and work", 0.0, np.max(np.abs(gained - work))),
    ):
        row = Row(
            f"lift, {name}",
            "J",
            energy,
            float(theirs),
            float(ours),
            10.5,
            ENERGY_REASON,
            scale=scale,
        )
        rows.append(row)
    return rows


def draw(figure: Figure) -> None:
    left, right = figure.subplots(1, 2, width_ratios=[1.1, 1.0])
    arm, result = boom(), lift()
    for t in (0.0, 2.0, 3.0, 4.0, 5.0, 6.0, DURATION):
        state = result.sel(time=t, method="nearest")
        axis = arm.shape(state.q.values, stations=20).reshape(-1, 2)
        rigid = arm.rigid().shape(state.joint_angle.values, stations=2)
        joints = np.append(rigid[:, 0], rigid[-1:, -1], axis=0)
        shown = {} if t == 0.0 else {"label": "_"}
        left.plot(*joints.T, **{**RIGID, **shown})
        left.plot(*axis.T, **{**FLEXIBLE, **shown})
    left.plot(*result.tip.values.T, color=VERMILLION, label="path of the tip")
    left.plot(0, 0, "o", color=INK, markersize=4, markerfacecolor="white")
    left.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=(-1, 27))
    left.grid(False)
    left.set_title("Lift")
    lines, names = left.get_legend_handles_labels()
    left.legend(lines, names, loc="lower left")
    t = result.time.values
    work, gained = work_and_energy()
    right.plot(t, 1e-3 * work, color=INK)
    right.text(4.0, 192.0, "work of the motors,", ha="right", fontsize=8)
    right.text(3.8, 176.0, "sum (dots)", ha="right", fontsize=8)
    kinds = ("gravity_energy", "kinetic_energy", "strain_energy")
    for kind, colour in zip(kinds, SERIES, strict=False):
        values = result[kind].values - result[kind].values[0]
        right.plot(t, 1e-3 * values, color=colour)
    places = ((5.2, 180), (4.0, 17), (7.3, -16))
    for place, kind, colour in zip(places, kinds, SERIES, strict=False):
        right.text(*place, kind.split("_")[0], color=colour, fontsize=8)
    every = slice(None, None, len(t) // 12)
    right.plot(t[every], 1e-3 * gained[every], "o", color=INK, markersize=3, clip_on=False)
    right.set(xlabel="time [s]", ylabel="energy [kJ]", xlim=(0, DURATION), ylim=(-25, 290))
    right.set_title("Energy since the start")


CASE = Case(
    name="boom",
    title="Five-link boom",
    physics=PHYSICS,
    quantities=quantities,
    draw=draw,
    caption="Left: the boom during the lift; dashed, a rigid boom at the same joint angles; "
    "vermilion, the path of the tip. Right: the work of the motors equals the energy "
    "gained.",
    module="gallery/cases/boom.py",
    size=(6.6, 3.2),
)
