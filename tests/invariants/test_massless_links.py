"""Rigid links without mass are levers."""

import numpy as np
import pytest

import flexarm as fa

LEVER = {"mass_per_length": 0.0, "flexible": False}
ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
GRAVITY = 9.81


def test_mass_on_a_massless_link_is_a_pendulum():
    arm = fa.Arm(
        links=[fa.Link(length=0.7, **LEVER)],
        payload=fa.Payload(mass=2.0),
        gravity=(0.0, -GRAVITY),
    )
    angle, torque = 0.4, 3.0
    wanted = -GRAVITY / 0.7 * np.cos(angle) + torque / (2.0 * 0.7**2)
    assert arm.forward_dynamics([angle], [0.0], [torque])[0] == pytest.approx(wanted, rel=1e-14)
    swung = fa.simulate(arm, 1.0, initial=[-1.4], rate=1000, rtol=1e-10, atol=1e-12)
    energy = (swung.kinetic_energy + swung.gravity_energy).values
    # The tolerance over a hundred steps, relative to m g L = 14 J.
    np.testing.assert_allclose(energy, energy[0], rtol=0, atol=1e-7)
    assert np.ptp(swung.kinetic_energy.values) > 0.1


@pytest.mark.parametrize(
    "fields",
    [
        {"links": [fa.Link(length=0.7, **LEVER), fa.Link(length=1.0, elements=2, **ROD)]},
        {
            "links": [fa.Link(length=0.7, **LEVER), fa.Link(length=0.5, **LEVER)],
            "joints": [fa.Joint(), fa.Joint(mass=1.0, hub_inertia=0.1)],
        },
        {
            "links": [fa.Link(length=1.0, elements=2, **ROD), fa.Link(length=0.5, **LEVER)],
            "payload": fa.Payload(mass=1.0, offset=(0.1, 0.2)),
        },
    ],
    ids=["before a beam", "on a hub", "behind a beam"],
)
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_massless_link_is_the_limit_of_a_light_bar(fields, theory):
    arm = fa.Arm(**fields, theory=theory, gravity=(0.0, -GRAVITY))
    light = fa.Arm(
        arm.spec.replace(
            links=[
                link if link.flexible else link.replace(mass_per_length=1e-9)
                for link in arm.spec.links
            ]
        )
    )
    runs = [
        fa.simulate(a, 0.3, initial=a.rest([0.4, -0.7]), rate=100, rtol=1e-10, atol=1e-12)
        for a in (arm, light)
    ]
    # The mass of the bar is 1e-9 beside half a kilogram.
    np.testing.assert_allclose(runs[0].tip, runs[1].tip, rtol=0, atol=1e-7)
    assert np.ptp(runs[0].tip.values, axis=0).max() > 0.1


def test_posture_without_inertia_is_reported():
    """A point mass at the end of two levers in line has no inertia about the elbow."""
    arm = fa.Arm(links=[fa.Link(length=1.0, **LEVER)] * 2, payload=fa.Payload(mass=1.0))
    bent = arm.forward_dynamics([0.3, 1.0], [0.0, 0.0], [1.0, 1.0])
    assert np.all(np.isfinite(bent))
    with pytest.raises(fa.InputError, match="the mass matrix is singular in this posture"):
        arm.forward_dynamics([0.3, 0.0], [0.0, 0.0], [1.0, 1.0])
