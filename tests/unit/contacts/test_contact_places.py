"""Contacts on arms of every kind: forces as loads, derivatives, symmetry, and wrong input."""

import numpy as np
import pytest

import flexarm as fa
from arm_states import drawn
from flexarm.arm.actions import place_contacts
from flexarm.arm.observe import contact_values
from flexarm.kernels.forces.contact import BEND, FORCE, GAP, VELOCITY
from random_options import busy

SEEDS = range(2000, 2020)


def drawn_contacts(arm, q, seed):
    """Return contacts that are all active in a posture, at the tip and inside links."""
    rng = np.random.default_rng(seed)
    contacts = []
    for number in range(3):
        link = int(rng.integers(1, arm.n_links + 1))
        share = rng.uniform(0.2, 1.0)
        station = None if number == 0 else share * arm.spec.links[link - 1].length
        point = point_of(arm, q, link, station)
        depth, turn = rng.uniform(1e-3, 2e-2), rng.uniform(-np.pi, np.pi)
        normal = np.array([np.cos(turn), np.sin(turn)])
        surface = [
            fa.Wall(point + depth * normal, normal),
            fa.RoundWall(point + (depth - 0.5) * normal, 0.5),
            wave(point + depth * normal, turn),
        ][int(rng.integers(3))]
        contacts.append(
            fa.Contact(
                surface,
                stiffness=rng.uniform(1e2, 1e3),
                link=link,
                station=station,
                exponent=rng.uniform(1.0, 2.0),
                damping=rng.uniform(0.0, 0.1),
                friction=rng.uniform(0.1, 0.6),
                friction_speed=rng.uniform(0.05, 1.0),
            )
        )
    return contacts


def wave(point, turn):
    """Return a wavy surface through a point with the given angle of its normal there."""
    x = np.linspace(-0.5, 0.5, 21)
    curve = np.stack([x, 0.02 * np.sin(9.0 * x) ** 2], axis=1)
    c, s = np.sin(turn), -np.cos(turn)  # the tangent
    return fa.SurfaceTable(*(point[:, None] + np.array([[c, -s], [s, c]]) @ curve.T))


def point_of(arm, q, link, station):
    """Return the world position of a point of the axis by ``Arm.shape``, which has no contacts."""
    if station is None:
        return arm.shape(q, stations=2)[link - 1, 1]
    stations = 2001
    line = arm.shape(q, stations=stations)[link - 1]
    place = station / arm.spec.links[link - 1].length * (stations - 1)
    k = min(int(place), stations - 2)
    return line[k] + (place - k) * (line[k + 1] - line[k])


@pytest.mark.sampled("2000", "2019")
@pytest.mark.parametrize("seed", SEEDS)
def test_contacts_equal_the_loads_of_their_forces(seed):
    """Accelerations with contacts and with their forces as loads agree to rounding."""
    b = busy(seed)
    contacts = drawn_contacts(b.arm, b.q, seed)
    placed = place_contacts(b.arm, contacts)
    state = b.arm.padded(np.stack([b.q, b.qd]))[None]
    values = contact_values(b.arm, placed, state)[0]
    assert np.all(values[:, GAP] < 0.0)
    pushes = [
        fa.Load(contact.link, values[k, FORCE : FORCE + 2], station=contact.station)
        for k, contact in enumerate(contacts)
    ]
    acting = b.q, b.qd, b.torque, b.tip_force
    wanted = b.arm.forward_dynamics(*acting, [*b.loads, *pushes], b.base_acceleration)
    found = b.arm.forward_dynamics(*acting, b.loads, b.base_acceleration, contacts)
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * abs(wanted).max())
    free = b.arm.forward_dynamics(*acting, b.loads, b.base_acceleration)
    # The contacts have an effect, even beside stiff modes: far more than the rounding above.
    assert abs(found - free).max() > 1e-7 * abs(found).max()
    back = b.arm.inverse_dynamics(
        b.q, b.qd, found, b.tip_force, b.loads, b.base_acceleration, contacts
    )
    # The torque is a small difference of large terms, each with its rounding: up to 1e-13 of their
    # sum was measured, hundreds of times less for most arms.
    terms = abs(b.arm.mass_matrix(b.q)) @ abs(found)
    error = abs(back[b.arm.joint_index] - b.torque)
    assert np.all(error <= 1e-11 * terms[b.arm.joint_index])


@pytest.mark.sampled("2000", "2019")
@pytest.mark.parametrize("seed", SEEDS)
def test_force_law_at_points_of_arm_shape(seed):
    """Position and velocity of the points without the contact's kernel; the law in NumPy."""
    b = busy(seed)
    contacts = [
        contact
        for contact in drawn_contacts(b.arm, b.q, seed)
        if not isinstance(contact.surface, fa.SurfaceTable)
    ]
    placed = place_contacts(b.arm, contacts)
    state = b.arm.padded(np.stack([b.q, b.qd]))[None]
    found = contact_values(b.arm, placed, state)[0] if contacts else []
    for contact, row in zip(contacts, found, strict=True):
        point, step = point_of(b.arm, b.q, contact.link, contact.station), 1e-6
        ahead = point_of(b.arm, b.q + step * b.qd, contact.link, contact.station)
        behind = point_of(b.arm, b.q - step * b.qd, contact.link, contact.station)
        velocity = (ahead - behind) / (2.0 * step)
        # Differences over 1e-6 s; chords of a thousandth of a link.
        np.testing.assert_allclose(row[VELOCITY : VELOCITY + 2], velocity, rtol=0, atol=2e-6)
        if isinstance(contact.surface, fa.Wall):
            normal = np.array(contact.surface.normal)
            gap = (point - contact.surface.point) @ normal
        else:
            away = point - contact.surface.center
            normal = away / np.linalg.norm(away)
            gap = np.linalg.norm(away) - contact.surface.radius
        push = contact.stiffness * (-gap) ** contact.exponent
        push *= max(0.0, 1.0 - contact.damping * (velocity @ normal))
        tangent = np.array([normal[1], -normal[0]])
        rub = -contact.friction * push * np.tanh(velocity @ tangent / contact.friction_speed)
        np.testing.assert_allclose(
            row[FORCE : FORCE + 2], push * normal + rub * tangent, rtol=0, atol=2e-4 * push + 1e-9
        )


@pytest.mark.sampled("2102", "2103")
@pytest.mark.parametrize("seed", range(2100, 2106))
def test_derivatives_equal_differences(seed):
    d = drawn(seed)
    contacts = drawn_contacts(d.arm, d.q, seed)
    exact = d.arm.derivatives(d.q, d.qd, d.torque, contacts=contacts)
    step = 1e-6
    for which, (by, point) in enumerate(((exact.q, d.q), (exact.qd, d.qd))):
        for k in range(d.arm.dof):
            ends = []
            for sign in (1.0, -1.0):
                moved = point.copy()
                moved[k] += sign * step
                q, qd = (moved, d.qd) if which == 0 else (d.q, moved)
                ends.append(d.arm.forward_dynamics(q, qd, d.torque, contacts=contacts))
            slope = (ends[0] - ends[1]) / (2.0 * step)
            # Central differences: step^2 times a third derivative, and rounding over the step.
            np.testing.assert_allclose(by[:, k], slope, rtol=1e-5, atol=1e-6 * abs(by).max())


def test_mirrored_contacts_have_mirrored_forces():
    d = drawn(5, gravity=False)
    if d.arm.spec.payload.offset[1]:
        pytest.skip("a payload beside the axis has a mirror image of its own")
    point = d.arm.tip(d.q)[:2]
    turn = 0.7
    normal = np.array([np.cos(turn), np.sin(turn)])
    flip = np.array([1.0, -1.0])
    law = {"stiffness": 1e3, "damping": 0.1, "friction": 0.3, "friction_speed": 0.1}
    for make in (
        lambda side: fa.Wall((point + 0.01 * normal) * side, normal * side),
        lambda side: fa.RoundWall((point - 0.3 * normal) * side, 0.31),
    ):
        one, other = (fa.Contact(make(side), **law) for side in (np.ones(2), flip))
        wanted = -d.arm.forward_dynamics(d.q, d.qd, d.torque, contacts=[one])
        found = d.arm.forward_dynamics(-d.q, -d.qd, -d.torque, contacts=[other])
        np.testing.assert_allclose(found, wanted, rtol=1e-11, atol=1e-11 * abs(wanted).max())


def test_inactive_contact_has_no_effect():
    d = drawn(8)
    far = fa.Contact(fa.Wall((0.0, -1e3), (0.0, 1.0)), 1e4, damping=1.0, friction=0.5)
    wanted = d.arm.forward_dynamics(d.q, d.qd, d.torque)
    found = d.arm.forward_dynamics(d.q, d.qd, d.torque, contacts=[far])
    np.testing.assert_allclose(found, wanted, rtol=1e-9)


@pytest.mark.parametrize("radius", [None, 0.25])
def test_point_exactly_on_a_surface_has_its_curvature(radius):
    link = fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=1.0, elements=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)])
    wall = fa.Wall((1.0, 0.0), (-1.0, 0.0))
    surface = wall if radius is None else fa.RoundWall((1.0 + radius, 0.0), radius)
    placed = place_contacts(arm, [fa.Contact(surface, stiffness=100.0)])
    row = contact_values(arm, placed, arm.padded(np.zeros((2, arm.dof)))[None])[0, 0]
    assert row[GAP] == 0.0
    assert row[BEND] == (0.0 if radius is None else 1.0 / radius)
