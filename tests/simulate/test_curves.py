"""A point that slides along a curve: a bead is a pendulum, a cam lifts its follower."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexarm as fa

G, MASS = 9.81, 0.5


def bead(curve: Any, **closure: Any) -> fa.Arm:
    """A mass on two slides, x and y, whose centre is on a curve."""
    slide = fa.Link(length=0.1, mass_per_length=0.0, flexible=False)
    return fa.Arm(
        links=[slide, slide.replace(parent_station=0.0)],
        joints=[fa.Joint(kind="prismatic"), fa.Joint(kind="prismatic", axis=(0.0, 1.0))],
        payload=fa.Payload(mass=MASS, inertia=1e-3, offset=-0.1),
        closures=[fa.Closure(kind="curve", link=2, station=0.0, shape=curve, **closure)],
        gravity=(0.0, -G),
    )


@pytest.mark.parametrize("inside", [False, True])
def test_bead_on_a_circle_swings_as_a_pendulum(inside: bool) -> None:
    radius, center, first, duration = 0.4, (0.2, -0.1), 2.0, 1.5
    arm = bead(fa.RoundWall(center, radius, inside))
    start = np.add(center, radius * np.array([np.sin(first), -np.cos(first)]))
    run = fa.simulate(arm, duration, initial=arm.rest(start), accuracy=1e-9, rate=100)

    def slope(t: float, y: np.ndarray) -> list[float]:
        return [y[1], -G / radius * np.sin(y[0])]

    exact = solve_ivp(
        slope, (0, duration), [first, 0], "DOP853", t_eval=run.time, rtol=1e-12, atol=1e-12
    )
    angle, rate = exact.y
    place = np.array([np.sin(angle), -np.cos(angle)]).T * radius + center
    # The accuracy, over a swing beyond the horizontal.
    np.testing.assert_allclose(run.joint_angle.values, place, rtol=0, atol=1e-8)
    pull = MASS * (G * np.cos(angle) + radius * rate**2)  # towards the centre
    force = run.closure_force.values[:, 0] * (1.0 if inside else -1.0)
    np.testing.assert_allclose(force, pull, rtol=0, atol=1e-6 * MASS * G)
    assert run.closure.values.tolist() == ["1 normal"]


@pytest.mark.parametrize("swing", [0.3, 1.2])
def test_bead_on_a_cycloid_is_isochronous(swing: float) -> None:
    size, period = 0.1, 4.0 * np.pi * np.sqrt(0.1 / G)
    angle = np.linspace(-2.2, 2.2, 121)
    curve = fa.SurfaceTable(size * (angle + np.sin(angle)), size * (1.0 - np.cos(angle)))
    arm = bead(curve, to_offset=(0.3, 0.2), angle=0.0)
    x = [0.3 + size * (swing + np.sin(swing)), 0.2 + size * (1.0 - np.cos(swing))]
    start = fa.assembled(arm, arm.rest(x)).q
    # The spline through the points is off by 1e-8 of the size.
    np.testing.assert_allclose(arm.joint_angles(start), x, rtol=0, atol=1e-7)
    run = fa.simulate(arm, period, initial=start, accuracy=1e-9, rate=4 / period)
    bottom = [0.3, 0.2]
    np.testing.assert_allclose(run.joint_angle.values[[1, 3]], [bottom, bottom], rtol=0, atol=1e-6)
    np.testing.assert_allclose(run.joint_angle.values[4], x, rtol=0, atol=1e-6)


def cam(curve: Any, eccentricity: float) -> fa.Arm:
    """A cam that turns about the origin and a follower that slides along the y axis."""
    return fa.Arm(
        links=[
            fa.Link(length=0.2, mass_per_length=2.0, flexible=False),
            fa.Link(length=0.3, mass_per_length=1.0, parent=0, flexible=False),
        ],
        joints=[
            fa.Joint(),
            fa.Joint(kind="prismatic", axis=(0.0, 1.0), mounting_angle=np.pi / 2),
        ],
        closures=[
            fa.Closure(
                kind="curve",
                link=2,
                station=0.0,
                to_link=1,
                to_station=0.0,
                to_offset=(eccentricity, 0.0),
                angle=0.7,
                shape=curve,
            )
        ],
    )


ROUND = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@pytest.mark.parametrize(
    "curve",
    [
        fa.RoundWall((0.0, 0.0), 0.1),
        fa.SurfaceTable(0.1 * np.cos(-ROUND), 0.1 * np.sin(-ROUND), closed=True),
    ],
)
def test_eccentric_cam_lifts_its_follower(curve: Any) -> None:
    radius, e, rate = 0.1, 0.04, 5.0
    arm = cam(curve, e)
    start = fa.assembled(arm, arm.rest([0.3, 0.12]), arm.rest([rate, 0.0]), held=[1])
    turn = fa.PrescribedAngle(lambda t: 0.3 + rate * t, lambda t: rate, lambda t: 0.0)
    run = fa.simulate(
        arm, 1.0, initial=start.q, initial_rate=start.qd, prescribed={1: turn}, accuracy=1e-9
    )
    angle = 0.3 + rate * run.time.values
    root = np.sqrt(radius**2 - (e * np.cos(angle)) ** 2)
    lift = e * np.sin(angle) + root
    # The spline through 48 points of the circle is off by 4e-7 of its radius.
    np.testing.assert_allclose(run.joint_angle.values[:, 1], lift, rtol=0, atol=1e-7)
    if isinstance(curve, fa.SurfaceTable):  # whose curvature is off by percents
        return
    # The force of the cam along its normal accelerates the follower.
    mixed = e**2 * np.cos(angle) * np.sin(angle)
    second = e**2 * np.cos(2.0 * angle) / root - mixed**2 / root**3 - e * np.sin(angle)
    expected = 0.3 * second * rate**2 * radius / root
    np.testing.assert_allclose(run.closure_force.values[:, 0], expected, rtol=0, atol=1e-6)


def test_modes_and_linear_model_contain_the_curvature() -> None:
    radius = 0.4
    arm = bead(fa.RoundWall((0.2, -0.1), radius, inside=True))
    start = fa.assembled(arm, arm.rest([0.25, -0.45])).q
    rest = fa.equilibrium(arm, start=start, held=[])
    np.testing.assert_allclose(arm.joint_angles(rest.q), [0.2, -0.5], rtol=0, atol=1e-9)
    frequency = np.sqrt(G / radius) / (2.0 * np.pi)
    assert fa.modes(arm, rest, "free").frequency_hz == pytest.approx([frequency], rel=1e-9)
    poles = np.linalg.eigvals(fa.linearize(arm, rest).A)
    assert np.abs(poles.imag) == pytest.approx(2.0 * np.pi * frequency, rel=1e-9)


def sliding_arm(**fields: Any) -> fa.Arm:
    """An arm of two flexible links whose tip slides on a tabulated ellipse."""
    bar = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 2}
    x, y = 0.7 + 0.3 * np.cos(-ROUND), 0.2 + 0.2 * np.sin(-ROUND)
    curve = fa.SurfaceTable(x, y, closed=True)
    return fa.Arm(
        links=[fa.Link(length=0.6, **bar), fa.Link(length=0.8, **bar)],
        closures=[fa.Closure(kind="curve", link=2, shape=curve)],
        gravity=(0.0, -G),
        **fields,
    )


def test_methods_agree_and_keep_a_tip_on_its_curve() -> None:
    arm = sliding_arm(theory="second_order")
    start = fa.assembled(arm, arm.rest([1.2, -2.0]), arm.rest([1.0, 0.0]), held=[1])
    tips = []
    for options in (
        {"integrator": "dormand_prince_8", "accuracy": 1e-7},
        {"integrator": "kennedy_carpenter_5", "accuracy": 1e-7},
        {"integrator": "rk4", "step": 2e-5},
    ):
        run = fa.simulate(arm, 0.3, initial=start.q, initial_rate=start.qd, rate=100, **options)
        tips.append(run.tip.values)
        gaps = [np.abs(arm.closure_gaps(q)).max() for q in run.q.values]
        assert max(gaps) < 1e-9 * arm.reach
        energy = (run.kinetic_energy + run.strain_energy + run.gravity_energy).values
        assert np.ptp(energy) < 1e-5 * run.kinetic_energy.values.max()
    for tip in tips[1:]:
        np.testing.assert_allclose(tip, tips[0], rtol=0, atol=1e-6)


def test_curves_are_read_from_files_and_written_again(tmp_path: Any) -> None:
    arm = sliding_arm()
    path = tmp_path / "arm.yaml"
    fa.save_arm(arm, path)
    again = fa.load_arm(path)
    assert again.spec.closures == arm.spec.closures
    q = arm.rest([1.2, -2.0])
    np.testing.assert_array_equal(again.closure_gaps(q), arm.closure_gaps(q))


def test_two_curves_of_one_point_differ() -> None:
    curve = fa.Closure(kind="curve", link=2, shape=fa.RoundWall((0.0, 0.0), 1.0))
    other = curve.replace(shape=fa.RoundWall((0.5, 0.0), 1.0))
    links = [fa.Link(length=0.6, mass_per_length=0.5, flexural_rigidity=20.0)] * 2
    assert fa.Arm(links=links, closures=[curve, other]).closure_rows == 2
    with pytest.raises(fa.ModelError, match=r"closures\[1\] has the points of closures\[0\]"):
        fa.Arm(links=links, closures=[curve, curve])
