"""Contacts over time: energy, restitution, friction, and no contact that is missed."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import flexarm as fa
from flexarm.integrate import INTEGRATORS

FOLLOWING = [name for name, kind in INTEGRATORS.items() if kind.follows_contacts]
#: A rod of 3 kg and 1 m on a joint at its end: 1 kg effective mass at its tip.
ROD = {"length": 1.0, "mass_per_length": 3.0}
CEILING = fa.Wall((0.0, 0.3), (0.0, -1.0))


def rod(**more):
    return fa.Arm(links=[fa.Link(**ROD, flexible=False)], **more)


def beam(**more):
    link = fa.Link(**ROD, flexural_rigidity=600.0, elements=2, modes=2)
    return fa.Arm(links=[link], theory="second_order", **more)


def total_energy(result):
    parts = result.kinetic_energy + result.strain_energy + result.gravity_energy
    return (parts + result.contact_energy.sum("contact")).values


def integrated(contact, rate, until, start=0.0):
    """Integrate the rod against the ceiling by SciPy, with the contact law written out; return
    angle and rate at ``until``."""
    k, n, c = contact.stiffness, contact.exponent, contact.damping

    def slope(t, y):
        depth = max(np.sin(y[0]) - 0.3, 0.0)
        push = k * depth**n * max(1.0 + c * np.cos(y[0]) * y[1], 0.0)
        slide = -np.sin(y[0]) * y[1]  # velocity of the tip along x
        rub = -contact.friction * push * np.tanh(slide / contact.friction_speed)
        return [y[1], -np.cos(y[0]) * push - np.sin(y[0]) * rub]

    run = solve_ivp(
        slope, (0.0, until), [start, rate], "DOP853", rtol=1e-12, atol=1e-13, max_step=1e-4
    )
    return run.y[:, -1]


# Contact law over time ---------------------------------------------------------------------------


@pytest.mark.sampled("law6-2.5")
@pytest.mark.parametrize(
    ("law", "rate"),
    [
        ({"stiffness": 1e4}, 1.0),
        ({"stiffness": 1e4}, 4.0),
        ({"stiffness": 1e5, "exponent": 1.5}, 2.0),
        ({"stiffness": 1e4, "damping": 0.3}, 2.0),
        ({"stiffness": 1e5, "exponent": 1.5, "damping": 0.5}, 1.0),
        ({"stiffness": 1e4, "friction": 0.4, "friction_speed": 0.01}, 1.5),
        ({"stiffness": 3e4, "damping": 0.2, "friction": 0.3, "friction_speed": 0.02}, 2.5),
    ],
)
def test_impact_equals_scipy_integration(law, rate):
    contact = fa.Contact(CEILING, **law)
    until = 0.4 / rate + 0.1
    result = fa.simulate(
        rod(), until, initial_rate=[rate], contacts=[contact], rtol=1e-10, atol=1e-12
    )
    angle, rate_after = integrated(contact, rate, float(result.time[-1]))
    # Step control keeps about seven digits across a corner in the force.
    np.testing.assert_allclose(result.joint_angle[-1, 0], angle, rtol=0, atol=1e-7)
    np.testing.assert_allclose(result.joint_rate[-1, 0], rate_after, rtol=1e-6)


def rebound(damping, speed):
    """Return the speed of a mass after contact with Hunt and Crossley's surface at ``speed``.

    c v - ln(1 + c v) = -c u - ln(1 - c u), for any mass, stiffness and exponent.
    """
    taken = damping * speed - np.log1p(damping * speed)
    return brentq(
        lambda u: -damping * u - np.log1p(-damping * u) - taken, 0.0, (1.0 - 1e-12) / damping
    )


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("damping", [0.1, 1.0])
def test_restitution(damping, exponent):
    """The tip of a rod meets a wall along its normal."""
    wall = fa.Wall((1.0, 0.0), (0.0, -1.0))
    contact = fa.Contact(wall, 1e6, exponent=exponent, damping=damping)
    result = fa.simulate(
        rod(), 0.1, initial=[-0.02], initial_rate=[1.0], contacts=[contact], rtol=1e-9, atol=1e-11
    )
    # The depth is a thousandth of the length, so the arc is straight to a millionth.
    assert -result.joint_rate.values[-1, 0] == pytest.approx(rebound(damping, 1.0), rel=3e-5)


@pytest.mark.parametrize(
    ("restitution", "off"), [(0.95, 3e-3), (0.7, 3e-3), (0.5, 1.3e-2), (0.2, 4e-2), (0.1, 4e-2)]
)
def test_damping_from_a_restitution(restitution, off):
    """By the formula of the reference, with its stated error, and exactly by the equation."""
    wall = fa.Wall((1.0, 0.0), (0.0, -1.0))
    about = 1.5 * (1.0 - restitution) / restitution
    exact = brentq(
        lambda c: rebound(c, 1.0) - restitution, 0.3 * about, min(1.5 * about, 1.0 / restitution)
    )
    # The how-to solves the same equation for the damping; both searches have a tolerance of 1e-12.
    e = restitution
    assert np.log1p(exact) - np.log1p(-exact * e) == pytest.approx(exact * (1.0 + e), rel=1e-6)
    for damping, allowed in ((about, off), (exact, 3e-5)):
        contact = fa.Contact(wall, 1e6, damping=damping)
        result = fa.simulate(
            rod(), 0.6, initial=[-0.02], initial_rate=[1.0], contacts=[contact], rtol=1e-9,
            atol=1e-11,
        )  # fmt: skip
        assert result.contact_gap[-1, 0] > 0.0
        assert -result.joint_rate.values[-1, 0] == pytest.approx(restitution, abs=allowed)


@pytest.mark.parametrize("make", [rod, beam])
def test_bouncing_conserves_energy(make):
    """Under gravity on an elastic floor without friction."""
    arm = make(gravity=(0.0, -9.81))
    floor = fa.Wall((0.0, -0.2), (0.1, 1.0))
    contact = fa.Contact(floor, 2e4, exponent=1.5)
    result = fa.simulate(arm, 2.0, contacts=[contact], rate=2000, rtol=1e-11, atol=1e-13)
    energy = total_energy(result)
    touches = np.diff((result.contact_gap[:, 0].values < 0.0).astype(int))
    assert np.sum(touches == 1) >= 3
    assert result.contact_energy.max() > 0.3
    # Every corner of the force loses some of the eleven digits of a smooth motion.
    assert np.ptp(energy) < 1e-7 * float(result.kinetic_energy.max())


@pytest.mark.parametrize("make", [rod, beam])
def test_lost_energy_is_the_work_of_damping_and_friction(make):
    contact = fa.Contact(CEILING, 1e4, damping=0.2, friction=0.3, friction_speed=0.02)
    arm = make()
    result = fa.simulate(
        arm, 0.5, initial_rate=arm.rest([2.0]), contacts=[contact], rate=20000, rtol=1e-10,
        atol=1e-12,
    )  # fmt: skip
    energy = total_energy(result)
    force, velocity = result.contact_force[:, 0].values, result.tip_velocity.values
    depth = np.maximum(-result.contact_gap[:, 0].values, 0.0)
    elastic = np.stack([0.0 * depth, -1e4 * depth], axis=1)  # force of the spring alone
    power = np.sum((force - elastic) * velocity, axis=1)
    lost = np.trapezoid(power, result.time)
    assert lost < -0.1
    # The trapezoidal rule at 20 kHz.
    assert energy[-1] - energy[0] == pytest.approx(lost, rel=1e-4)
    assert np.all(power <= 1e-9)


def test_force_at_rest_is_torque_over_lever():
    contact = fa.Contact(CEILING, 1e4, damping=2.0)
    arm = beam(joints=[fa.Joint(damping=5.0)])
    result = fa.simulate(arm, 6.0, torque=lambda t: [8.0], contacts=[contact], rate=100)
    tip = result.tip[-1].values
    force = result.contact_force[-1, 0].values
    assert force[0] == pytest.approx(0.0, abs=1e-12)
    assert -force[1] * tip[0] == pytest.approx(8.0, rel=1e-4)
    assert -float(result.contact_gap[-1, 0]) == pytest.approx(-force[1] / 1e4, rel=1e-6)
    assert tip[1] == pytest.approx(0.3 - force[1] / 1e4, abs=1e-6)


def test_sliding_friction_is_coulombs():
    """A tip is driven along a floor: mu N against the motion; ``N`` from the balance of moments."""
    floor = fa.Wall((0.0, -0.1), (0.0, 1.0))
    contact = fa.Contact(floor, 1e5, damping=5.0, friction=0.4, friction_speed=1e-3)
    links = [fa.Link(length=1.0, mass_per_length=0.5, flexible=False)] * 2
    arm = fa.Arm(links=links, joints=[fa.Joint(), fa.Joint(damping=0.5)])
    first = 0.7 - 0.15 * np.sin(np.linspace(0.0, 2.0 * np.pi, 9))  # there and back
    drawn = fa.PrescribedAngle.table(np.linspace(0.0, 1.6, 9), first)
    result = fa.simulate(
        arm, 1.6, initial=arm.rest([0.7, -1.5]), torque=lambda t: [0.0, -5.0], contacts=[contact],
        prescribed={1: drawn},
    )  # fmt: skip
    gliding = (abs(result.tip_velocity[:, 0]) > 0.02) & (result.contact_gap[:, 0] < 0.0)
    force = result.contact_force[:, 0].values[gliding.values]
    sense = np.sign(result.tip_velocity.values[gliding.values, 0])
    # Pulled and pushed; at a steeper angle a pushed tip would jam and hop.
    assert np.sum(sense == 1.0) > 400
    assert np.sum(sense == -1.0) > 400
    assert force[:, 1].min() > 1.0
    # tanh(20) equals one in double precision.
    np.testing.assert_allclose(force[:, 0], -0.4 * sense * force[:, 1], rtol=1e-12)


# No contact is missed between steps --------------------------------------------------------------


@pytest.mark.parametrize("name", FOLLOWING)
def test_fast_tip_on_a_stiff_wall(name):
    """12 m/s on 1e6 N/m with default tolerances: the tip returns, with a depth of v / omega at
    most."""
    contact = fa.Contact(fa.Wall((1.0, 0.0), (0.0, -1.0)), 1e6)
    result = fa.simulate(
        rod(), 0.2, initial=[-1.0], initial_rate=[12.0], contacts=[contact], integrator=name
    )
    assert float(result.contact_gap.min()) >= -12.0 * np.sqrt(1.0 / 1e6) * 1.001
    # Step control to 1e-7 a step leaves 1e-5 at the two corners of the force; a fixed step of half
    # a radian of the contact vibration, a per cent.
    loose = 1e-4 if INTEGRATORS[name].adaptive else 1e-2
    assert float(result.joint_rate[-1, 0]) == pytest.approx(-12.0, rel=loose)


@pytest.mark.parametrize("name", [n for n in FOLLOWING if INTEGRATORS[n].adaptive])
@pytest.mark.parametrize("speed", [1.0, 10.0, 30.0])
def test_contact_with_a_thin_post_is_not_missed(name, speed):
    """A rigid arm turns at constant rate, for which any step is accurate; the post is 5 mm
    thick."""
    post = fa.RoundWall((0.0, 1.0), 0.0025)
    contact = fa.Contact(post, 1e9)
    result = fa.simulate(
        rod(),
        3.0 / speed,
        initial_rate=[speed],
        contacts=[contact],
        integrator=name,
        rate=50 * speed,
    )
    assert float(result.joint_rate[-1, 0]) == pytest.approx(-speed, rel=1e-3)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [n for n in FOLLOWING if INTEGRATORS[n].adaptive])
def test_grazing_contact_with_a_wall_is_not_missed(name):
    """A tip on a circle of 1 m reaches 2 mm into a wall, within 0.13 rad."""
    contact = fa.Contact(fa.Wall((0.0, 0.998), (0.0, -1.0)), 1e5)
    result = fa.simulate(
        rod(), 1.0, initial_rate=[3.0], contacts=[contact], integrator=name, rate=5000
    )
    exact = solve_ivp(
        lambda t, y: [y[1], -np.cos(y[0]) * 1e5 * max(np.sin(y[0]) - 0.998, 0.0)],
        (0.0, 1.0), [0.0, 3.0], "DOP853", rtol=1e-12, atol=1e-12, max_step=1e-4,
    )  # fmt: skip
    assert float(result.joint_angle[-1, 0]) == pytest.approx(exact.y[0, -1], abs=1e-5)


def test_fixed_step_too_long_for_a_contact_ends_the_run():
    contact = fa.Contact(fa.Wall((1.0, 0.0), (0.0, -1.0)), 1e6)
    with pytest.raises(
        fa.SimulationError, match="fixed step is too long to resolve a contact"
    ) as reported:
        fa.simulate(rod(), 0.2, initial=[-1.0], initial_rate=[12.0], contacts=[contact], step=5e-3)
    assert 0.07 < reported.value.time < 0.09
    assert reported.value.result.sizes["time"] > 70


@pytest.mark.parametrize(
    ("stiffness", "radius", "speed"), [(1e3, 0.01, 5.0), (10.0, 0.01, 5.0), (1.0, 0.0025, 20.0)]
)
def test_contact_too_soft_for_the_impact_ends_the_run(stiffness, radius, speed):
    """Soft surfaces, which hardly change the velocity, are not skipped either."""
    contact = fa.Contact(fa.RoundWall((0.0, 1.0), radius), stiffness)
    with pytest.raises(fa.SimulationError, match="passed through its surface"):
        fa.simulate(rod(), 10.0 / speed, initial_rate=[speed], contacts=[contact])


# Channels of a result ----------------------------------------------------------------------------


def test_contact_channels_exist_with_contacts_only():
    contact = fa.Contact(CEILING, 1e4)
    result = fa.simulate(rod(), 0.01, contacts=[contact, contact], rate=100)
    assert result.contact_force.dims == ("time", "contact", "axis")
    assert result.contact_gap.dims == result.contact_energy.dims == ("time", "contact")
    np.testing.assert_allclose(result.contact_gap, 0.3, rtol=1e-15)
    assert result.contact.values.tolist() == [1, 2]
    assert not any("contact" in name for name in fa.simulate(rod(), 0.01, rate=100).variables)


def test_reactions_and_section_forces_include_contacts():
    """At rest between motor and wall the reaction of the joint balances the contact force."""
    contact = fa.Contact(CEILING, 1e4, damping=2.0, station=0.8)
    arm = beam(joints=[fa.Joint(damping=5.0)])
    result = fa.simulate(arm, 6.0, torque=lambda t: [8.0], contacts=[contact], rate=10, stations=11)
    last = result.isel(time=-1)
    np.testing.assert_allclose(
        last.joint_force[0].values + last.contact_force[0].values, 0.0, atol=1e-3
    )
    moment = last.bending_moment[0].values
    assert moment[0] == pytest.approx(-8.0, rel=1e-3)
    np.testing.assert_allclose(moment[8:], 0.0, atol=1e-3)  # no force outboard of the contact
    assert last.attrs["integrator_reason"]
