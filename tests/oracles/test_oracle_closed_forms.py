"""The oracle of mechanisms with rigid links against closed forms, and these against each other."""

import numpy as np
import pytest

from closed_mechanisms import CLOSED, FOUR_BAR, SLIDER_CRANK, four_bar, slider_crank
from flexarm.model import ArmSpec, Base, Joint, Link

from .mechanisms import MechanismOracle
from .rigid_mechanisms import (
    CartPendulum,
    Flying,
    TwoBodies,
    caught,
    cross,
    eksergian,
    kinetic_energy,
    parallelogram_energy,
)

#: Rounding of a few dozen operations, relative to results of order one to a hundred.
ROUNDING = 1e-12


def closed_rates(oracle, q, rate):
    """Return rates (dof,) of a mechanism of one degree of freedom from that of the crank."""
    jacobian = oracle.gap_jacobian(q)
    others = np.linalg.solve(jacobian[:, 1:], -jacobian[:, 0] * rate)
    return np.concatenate([[rate], others])


@pytest.mark.parametrize("crank", [0.3, 1.9, -2.5])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_slider_crank(crank, theory):
    case = slider_crank(crank, flexible=False, theory=theory)
    oracle = MechanismOracle(case.spec)
    rate, torque = 7.0, 0.6
    qd = closed_rates(oracle, case.joints, rate)
    found = oracle.at(case.joints, qd, [torque, 0.0])
    angles, force = SLIDER_CRANK.motion(crank, rate, torque)
    assert abs(found.gap).max() < 1e-15
    rod = SLIDER_CRANK.angles(crank)[1]
    np.testing.assert_allclose(qd[1], (rod.first - 1.0) * rate, rtol=ROUNDING)
    relative = np.array([angles[0], angles[1] - angles[0]])
    np.testing.assert_allclose(found.acceleration, relative, rtol=ROUNDING)
    np.testing.assert_allclose(found.closure_force, [force], rtol=ROUNDING)
    np.testing.assert_allclose(found.tips[1, :2], SLIDER_CRANK.end(crank).value, rtol=ROUNDING)
    energy = kinetic_energy(SLIDER_CRANK.bodies(crank), rate)
    np.testing.assert_allclose(found.kinetic, energy, rtol=ROUNDING)


@pytest.mark.parametrize("crank", [0.3, 1.9, -2.5])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_four_bar(crank, theory):
    case = four_bar(crank, flexible=False, theory=theory)
    oracle = MechanismOracle(case.spec)
    rate, torque = -5.0, 0.4
    qd = closed_rates(oracle, case.joints, rate)
    found = oracle.at(case.joints, qd, [torque, 0.0, 0.0])
    assert abs(found.gap).max() < 1e-14  # of lengths of one metre by square roots
    angles, force = FOUR_BAR.motion(crank, rate, torque)
    relative = [angles[0], angles[1] - angles[0], angles[2]]
    np.testing.assert_allclose(found.acceleration, relative, rtol=ROUNDING)
    np.testing.assert_allclose(found.closure_force, force, rtol=ROUNDING)
    energy = kinetic_energy(FOUR_BAR.bodies(crank), rate)
    np.testing.assert_allclose(found.kinetic, energy, rtol=ROUNDING)


@pytest.mark.parametrize("shape", [FOUR_BAR, SLIDER_CRANK])
def test_kinematic_coefficients_are_derivatives(shape):
    """First and second derivatives by the angle of the crank, and the change of the energy."""
    crank, step = 0.9, 1e-3
    here = shape.bodies(crank)
    around = [shape.bodies(crank + k * step) for k in (-2, -1, 1, 2)]

    def derivative(of):
        """Fourth-order central difference: truncation and rounding are below 1e-11."""
        far, near, ahead, back = (np.array(of(bodies)) for bodies in around)
        return (8 * (ahead - near) - (back - far)) / (12 * step)

    for k, body in enumerate(here):
        for name in ("centre", "angle"):
            exact = getattr(body, name)
            slope = derivative(lambda bodies, k=k, name=name: getattr(bodies[k], name).value)
            np.testing.assert_allclose(slope, exact.first, atol=1e-10)
            slope = derivative(lambda bodies, k=k, name=name: getattr(bodies[k], name).first)
            np.testing.assert_allclose(slope, exact.second, atol=1e-10)
    # Without torque and weight the kinetic energy is constant.
    rate = 4.0
    acceleration = eksergian(here, rate, 0.0, (0.0, 0.0))
    slope = derivative(lambda bodies: kinetic_energy(bodies, rate))
    inertia = 2.0 * kinetic_energy(here, 1.0)
    np.testing.assert_allclose(inertia * acceleration + slope, 0.0, atol=1e-10)


@pytest.mark.parametrize("slides", [False, True])
def test_cart_with_pendulum(slides):
    """The cart is a base that moves along x, or a link on a sliding joint that carries the rod."""
    cart = CartPendulum(2.0, 0.8, 0.4, stiffness=30.0, damping=1.5, gravity=(0.7, -9.81))
    rod = Link(length=cart.length, mass_per_length=cart.mass / cart.length, flexible=False)
    if slides:
        body = Link(length=0.3, mass_per_length=cart.cart / 0.3, flexible=False)
        rail = Joint(kind="prismatic", stiffness=cart.stiffness, damping=cart.damping)
        fields = {"links": [body, rod.replace(parent_station=0.0)], "joints": [rail, Joint()]}
    else:
        base = Base(
            mass=cart.cart,
            inertia=3.0,  # has no effect
            free=("x",),
            stiffness=(cart.stiffness, 0.0, 0.0),
            damping=(cart.damping, 0.0, 0.0),
        )
        fields = {"links": [rod], "base": base}
    oracle = MechanismOracle(ArmSpec(**fields, gravity=cart.gravity))
    q, qd, torque = [0.3, 2.0], [-0.8, 4.0], 0.9
    force = 2.5 if slides else 0.0
    exact = cart.acceleration(q, qd, force, torque)
    found = oracle.at(np.array(q), np.array(qd), [force, torque] if slides else [torque])
    np.testing.assert_allclose(found.acceleration, exact, rtol=ROUNDING)


def test_momentum_of_a_rod_on_a_free_base():
    body = TwoBodies(mass=5.0, inertia=0.7, place=(0.4, 0.1), length=0.9, rod=1.2)
    link = Link(length=body.length, mass_per_length=body.rod / body.length, flexible=False)
    base = Base(mass=body.mass, inertia=body.inertia, free=("x", "y", "angle"))
    spec = ArmSpec(links=[link], joints=[Joint(offset=body.place)], base=base)
    oracle = MechanismOracle(spec)
    q, qd = np.array([0.3, -0.2, 0.5, 1.1]), np.array([0.4, 0.7, -1.3, 2.2])
    found = oracle.momentum(q, qd)
    tip = oracle.tips(q)[0]
    half = body.length / 2 * np.array([np.cos(tip[2]), np.sin(tip[2])])
    centre = (body.mass * q[:2] + body.rod * (tip[:2] - half)) / (body.mass + body.rod)
    spin = body.spin(q[2:], qd[2:])
    np.testing.assert_allclose(found[2] - cross(centre, found[:2]), spin, rtol=ROUNDING)
    # The rate of a base at rest at first, after the joint has started to turn.
    start = body.base_rate(q[2:], 2.2, 0.0)
    velocity = -body.rod / (body.mass + body.rod) * carried(oracle, q, start, 2.2)
    still = oracle.momentum(q, np.array([*velocity, start, 2.2]))
    np.testing.assert_allclose(still, 0.0, atol=1e-14)


def carried(oracle, q, base_rate, joint_rate):
    """Return the velocity (2,) of the centre of the rod from that of the base."""
    still = oracle.momentum(q, np.array([0.0, 0.0, base_rate, joint_rate]))
    return still[:2] / float(np.sum(oracle.points[0].mass))


def test_bodies_that_stick_keep_their_momentum():
    """The energy that is lost is that of the relative motion."""
    bodies = [
        Flying(2.0, 0.1, (0.0, 0.5), (1.0, -0.4), 2.0),
        Flying(0.7, 0.03, (0.3, -0.2), (-2.0, 0.1), -9.0),
    ]
    together = caught(bodies)
    np.testing.assert_allclose(together.momentum, sum(b.momentum for b in bodies), rtol=ROUNDING)
    lost = sum(energy(b) for b in bodies) - energy(together)
    relative = [
        Flying(
            b.mass,
            b.inertia,
            b.centre,
            np.subtract(b.velocity, velocity_of(together, b.centre)),
            b.rate - together.rate,
        )
        for b in bodies
    ]
    np.testing.assert_allclose(lost, sum(energy(b) for b in relative), rtol=ROUNDING)


def energy(body):
    """Return the kinetic energy, J."""
    velocity = np.asarray(body.velocity)
    return (body.mass * velocity @ velocity + body.inertia * body.rate**2) / 2


def velocity_of(body, point):
    """Return the velocity (2,) of a point of a body."""
    x, y = np.subtract(point, body.centre)
    return body.velocity + body.rate * np.array([-y, x])


@pytest.mark.parametrize("loops", [1, 4])
def test_energy_of_four_bars_in_a_row(loops):
    """Parallelograms: all cranks turn alike, and couplers do not turn."""
    case = CLOSED["parallelograms"](loops)
    oracle = MechanismOracle(case.spec)
    qd = closed_rates(oracle, case.joints, -1.0)
    alike = [-1.0, *[1.0, -1.0] * loops]
    np.testing.assert_allclose(qd, alike, rtol=ROUNDING)
    energy = sum(oracle.energy(case.joints, qd))
    np.testing.assert_allclose(energy, parallelogram_energy(loops), rtol=ROUNDING)
    # In the upright posture weight has no moment, and symmetry leaves no acceleration.
    found = oracle.at(case.joints, qd, np.zeros(len(qd)))
    np.testing.assert_allclose(found.acceleration, 0.0, atol=1e-13)


@pytest.mark.parametrize("name", CLOSED)
def test_postures_close_the_loops(name):
    case = CLOSED[name]()
    oracle = MechanismOracle(case.spec, precision=np.float64)
    q = np.zeros(oracle.dof)
    q[oracle.joint_index] = case.joints
    # Positions of about a metre by square roots and inverse functions.
    np.testing.assert_allclose(oracle.gaps(q), 0.0, atol=1e-14)
    values = np.linalg.svd(oracle.gap_jacobian(q), compute_uv=False)
    assert values[-1] > 0.01 * values[0]
