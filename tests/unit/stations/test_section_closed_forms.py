"""Forces inside moving links against closed forms of textbooks."""

import numpy as np
import pytest

import flexarm as fa

L, MU, G = 1.3, 0.8, 9.81
STATIONS = 13
X = np.linspace(0.0, L, STATIONS)
EXACT = {"rtol": 0, "atol": 1e-14}


def rod(**fields):
    link = fa.Link(length=L, mass_per_length=MU, flexible=False)
    return fa.Arm(links=[link], **fields)


def flexible(theory, **fields):
    link = fa.Link(length=L, mass_per_length=MU, flexural_rigidity=40.0, elements=4)
    return fa.Arm(links=[link], theory=theory, **fields)


@pytest.mark.parametrize("arm", [rod(), flexible("linear"), flexible("second_order")])
def test_axial_force_of_a_spinning_rod(arm):
    """N = mu w^2 (L^2 - x^2) / 2; a straight rod does not bend."""
    w = 3.0
    axial, shear, moment = arm.section_forces(
        arm.rest([0.7]), arm.rest([w]), 0 * arm.rest([0.0]), STATIONS
    )[0].T
    np.testing.assert_allclose(axial, MU * w**2 * (L**2 - X**2) / 2, **EXACT)
    np.testing.assert_allclose(shear, 0.0, **EXACT)
    np.testing.assert_allclose(moment, 0.0, **EXACT)


def test_falling_chimney_has_its_largest_moment_at_a_third():
    """A rod that falls from rest about its foot: M = m g sin(theta) x (L - x)^2 / (4 L^2).

    From the weight mu g sin(theta) and the inertia mu x theta'', theta'' = 3 g sin(theta) / (2 L),
    Newton's law from x to L gives the moment, largest at L / 3, and V = -dM/dx. The rate, from the
    energy, adds its centripetal part to the axial force. Varieschi and Kamiya, American Journal of
    Physics 71 (2003) 1025-1031.
    """
    arm, theta = rod(gravity=(0.0, -G)), 0.6
    q = np.array([np.pi / 2 - theta])  # theta from the vertical, falling to the right
    qd = [-np.sqrt(3.0 * G * (1.0 - np.cos(theta)) / L)]
    qdd = arm.forward_dynamics(q, qd, [0.0])
    assert qdd[0] == pytest.approx(-1.5 * G * np.sin(theta) / L, rel=1e-14)
    axial, shear, moment = arm.section_forces(q, qd, qdd, STATIONS)[0].T
    weight = MU * L * G * np.sin(theta)
    np.testing.assert_allclose(moment, weight * X * (L - X) ** 2 / (4 * L**2), **EXACT)
    np.testing.assert_allclose(shear, -weight * (L - X) * (L - 3 * X) / (4 * L**2), **EXACT)
    pull = 3.0 * (1.0 + X / L) - (5.0 + 3.0 * X / L) * np.cos(theta)
    np.testing.assert_allclose(axial, MU * L * G / 2 * (1.0 - X / L) * pull, **EXACT)
    assert X[np.argmax(moment)] == pytest.approx(L / 3)


def test_rod_in_free_fall_has_no_internal_forces():
    arm = rod(gravity=(2.0, -G))
    forces = arm.section_forces([0.3], [0.0], [0.0], STATIONS, base_acceleration=(2.0, -G))
    np.testing.assert_allclose(forces, 0.0, **EXACT)


def test_hub_reduces_the_moment_at_the_root():
    """A torque turns hub and rod; the rod receives only the part for its own inertia."""
    inertia, torque = 0.4, 3.0
    arm = rod(joints=[fa.Joint(hub_inertia=inertia)])
    (qdd,) = arm.forward_dynamics([0.0], [0.0], [torque])
    of_rod = MU * L**3 / 3
    assert qdd == pytest.approx(torque / (of_rod + inertia), rel=1e-14)
    moment = arm.section_forces([0.0], [0.0], [qdd], STATIONS)[0, :, 2]
    # The moment that bends with v'' > 0 is opposite to the acceleration.
    exact = -MU * qdd * (2 * L**3 - 3 * L**2 * X + X**3) / 6
    np.testing.assert_allclose(moment, exact, **EXACT)
    assert moment[0] == pytest.approx(-(torque - inertia * qdd), rel=1e-14)


def test_rotating_sections_require_a_moment():
    """Rotary inertia rho I per length of a rod that starts to turn."""
    link = fa.Link(length=L, mass_per_length=MU, rotary_inertia_per_length=0.05, flexible=False)
    arm = fa.Arm(links=[link])
    axial, shear, moment = arm.section_forces([0.2], [0.0], [2.0], STATIONS)[0].T
    np.testing.assert_allclose(axial, 0.0, **EXACT)
    np.testing.assert_allclose(shear, -MU * 2.0 * (L**2 - X**2) / 2, **EXACT)
    bare = -MU * 2.0 * (2 * L**3 - 3 * L**2 * X + X**3) / 6
    np.testing.assert_allclose(moment, bare - 0.05 * 2.0 * (L - X), **EXACT)


def test_link_carries_the_lumps_at_its_tip():
    """Motor of the next joint and payload act on the sections inboard of them."""
    link = fa.Link(length=L, mass_per_length=MU, flexible=False)
    joints = [fa.Joint(), fa.Joint(mass=0.5, housing_inertia=0.2)]
    payload = fa.Payload(mass=0.3, inertia=0.1, offset=(0.2, 0.0))
    arm = fa.Arm(links=[link, link], joints=joints, payload=payload)
    # Both links in line, the first turns: alpha at the base, the second joint at rest.
    alpha = 2.0
    forces = arm.section_forces([0.0, 0.0], [0.0, 0.0], [alpha, 0.0], STATIONS)
    tip = -0.3 * alpha * (2 * L + 0.2)
    assert forces[1, -1, 1] == pytest.approx(tip, rel=1e-13)
    assert forces[1, -1, 2] == pytest.approx(0.2 * tip - 0.1 * alpha, rel=1e-13)
    beyond = forces[1, 0]
    assert forces[0, -1, 1] == pytest.approx(beyond[1] - 0.5 * alpha * L, rel=1e-13)
    assert forces[0, -1, 2] == pytest.approx(beyond[2] - 0.2 * alpha, rel=1e-13)
