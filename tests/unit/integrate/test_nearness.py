"""How long a contact lasts, which limits the steps near surfaces."""

import math

import numpy as np
import pytest

import flexarm as fa
from flexarm.arm.actions import place_contacts
from flexarm.integrate.nearness import _fastest_change, turning_time
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.forces.contact import (
    BEND,
    DAMPING,
    EXPONENT,
    FRICTION,
    GAP,
    MOBILITY,
)


@compiled
def time_of(contacts, speed):
    return turning_time(contacts, 0, speed)


@compiled
def constant_of(contacts):
    return _fastest_change(contacts, 0)


@pytest.fixture
def contacts():
    link = fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=1.0, elements=1)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)])
    return place_contacts(arm, [fa.Contact(fa.Wall((1.0, 0.0), (-1.0, 0.0)), stiffness=100.0)])


@pytest.mark.parametrize("curvature", [0.0, -2.0])
def test_only_convex_surfaces_shorten_the_contact(contacts, curvature):
    """A linear spring stops a mass m at the speed v in the depth v sqrt(m / k)."""
    contacts.seen[:, 0, BEND] = curvature
    contacts.law[0, MOBILITY] = 0.5  # of a mass of 2 kg
    assert time_of(contacts, 0.3) == pytest.approx(math.sqrt(2.0 / 100.0), rel=1e-12)


def test_point_can_pass_through_a_post_in_the_time_of_its_radius(contacts):
    contacts.law[0, MOBILITY] = 0.5
    contacts.seen[:, 0, BEND] = 1.0 / 1e-3
    assert time_of(contacts, 0.3) == pytest.approx(1e-3 / 0.3, rel=1e-12)


def test_point_that_leaves_has_no_limit(contacts):
    assert time_of(contacts, np.float64(-0.1)) == math.inf


def test_resting_contact_vibrates_on_its_spring(contacts):
    """sqrt(m / k) for a linear spring, whatever the depth; the deeper end of the step counts."""
    contacts.law[0, MOBILITY] = 0.5
    contacts.law[0, DAMPING] = contacts.law[0, FRICTION] = 0.0
    contacts.seen[:, 0, GAP] = [0.002, -1e-3]
    assert constant_of(contacts) == pytest.approx(math.sqrt(2.0 / 100.0), rel=1e-12)
    contacts.law[0, EXPONENT] = 1.5  # k x^1.5 has the slope 1.5 k sqrt(x)
    slope = 1.5 * 100.0 * math.sqrt(1e-3)
    assert constant_of(contacts) == pytest.approx(math.sqrt(2.0 / slope), rel=1e-12)
