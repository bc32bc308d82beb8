"""Friction with bristles: the LuGre model, compared with its equations in SciPy."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexarm as fa
from bristled_joints import NUMBERS, PUBLISHED, RUBBING, lugre, turning
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.arm.observe import channels_of
from flexarm.integrate import INTEGRATORS


@cache
def run(torque, duration, **options):
    return fa.simulate(turning(), duration, torque=lambda t: [torque(t)], rate=1000.0, **options)


def half(t):
    return 0.5


def alternating(t):
    return np.sin(2.0 * np.pi * t)


def test_sticking_joint_holds():
    """Below the breakaway torque the joint deflects its bristles and stays there."""
    result = run(half, 1.1)
    angle, _, z = lugre(half, result.time.values)
    # The tolerance of the default is 1e-7 of the largest angle at the tip, which is at 1 m, in each
    # step, and 1e-9 m: the angle is below 1 mrad.
    np.testing.assert_allclose(result.joint_angle[:, 0], angle, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result.bristle_deflection[:, 0], z, rtol=0, atol=1e-8)
    assert z[-1] == pytest.approx(0.5 / 5000.0, rel=1e-6)
    moved = np.ptp(result.joint_angle.values[500:, 0])
    assert moved < 1e-8  # a function of the rate creeps by millirad


def test_reversals():
    """Four reversals: the joint slides, slips back on its bristles and sticks."""
    result = run(alternating, 2.0)
    angle, rate, z = lugre(alternating, result.time.values)
    assert np.ptp(angle) > 0.5
    assert np.abs(result.joint_angle.values[:, 0] - angle).max() < 1e-6
    assert np.abs(result.joint_rate.values[:, 0] - rate).max() < 1e-5
    assert np.abs(result.bristle_deflection.values[:, 0] - z).max() < 1e-6


#: Largest difference of the angle (rad) without bristles, by smoothing rate: decision 0033. None:
#: friction that holds, the limit of small ones.
DIFFERENCES = {0.01: 0.032, 0.008: 0.022, 0.005: 0.027, None: 0.0525}


@pytest.mark.parametrize("smoothing_rate", DIFFERENCES)
def test_function_of_the_rate_differs(smoothing_rate):
    own = {"bristle_stiffness": None, "bristle_damping": 0.0, "smoothing_rate": smoothing_rate}
    plain = turning(numbers={**NUMBERS, **own})
    result = fa.simulate(plain, 2.0, torque=lambda t: [alternating(t)], rate=1000.0)
    bristled = run(alternating, 2.0).joint_angle.values
    assert np.ptp(bristled) == pytest.approx(0.53, abs=0.005)
    # The numbers are rounded to three digits; the last one is just below the middle of two.
    difference = np.abs(result.joint_angle.values - bristled).max()
    assert difference == pytest.approx(DIFFERENCES[smoothing_rate], abs=0.0005)


@pytest.mark.parametrize(
    "name", [name for name, kind in INTEGRATORS.items() if kind.follows_bristles]
)
def test_every_method_that_supports_bristles(name):
    """The error follows the tolerance, so that the deflection is part of the estimate."""
    errors = []
    for rtol in (1e-6, 1e-9):
        result = run(alternating, 1.0, integrator=name, rtol=rtol, atol=1e-2 * rtol)
        angle, *_ = lugre(alternating, result.time.values)
        errors.append(np.abs(result.joint_angle.values[:, 0] - angle).max())
    assert errors[1] < 3e-9  # the reference has about a billionth
    assert errors[0] < 1e-4


# Published properties of the model ---------------------------------------------------------------


def test_published_stick_slip():
    """Section IV.D of the paper: an inertia of 1, pulled by a spring of 2 at the speed 0.1."""
    arm = turning(1.0, PUBLISHED, stiffness=2.0)

    def pulled(t):
        return 2.0 * 0.1 * t

    result = fa.simulate(arm, 20.0, torque=lambda t: [pulled(t)], rate=50.0, rtol=1e-9, atol=1e-11)
    times = result.time.values
    angle, rate, _ = lugre(pulled, times, 1.0, PUBLISHED, lambda angle, rate: -2.0 * angle)
    # Each slip multiplies earlier errors: the reference itself is accurate to about 1e-8.
    np.testing.assert_allclose(result.joint_angle.values[:, 0], angle, rtol=0, atol=1e-6)
    np.testing.assert_allclose(result.joint_rate.values[:, 0], rate, rtol=0, atol=1e-5)
    spring = pulled(times) - 2.0 * result.joint_angle.values[:, 0]
    still = np.abs(result.joint_rate.values[:, 0]) < 1e-4
    # The first slip begins shortly before the spring reaches the static friction, after 7.5 s.
    assert times[~still][0] == pytest.approx(7.4, abs=0.1)
    assert spring.max() == pytest.approx(1.5, abs=0.01)
    starts = np.flatnonzero(still[:-1] & ~still[1:])
    assert len(starts) >= 2  # it sticks again


def breakaway(rate):
    """Return the largest torque (N m) of the bristles at the joint of the paper."""
    arm, duration = turning(1.0, PUBLISHED), 2.0 / rate
    result = fa.simulate(arm, duration, torque=lambda t: [rate * t], rate=4000.0 / duration)
    z = result.bristle_deflection.values[:, 0]
    return 1e5 * z.max()


def test_breakaway_torque_falls_with_the_rate_of_the_torque():
    """Section IV.B of the paper: from near static friction towards the Coulomb level."""
    slow, middle, fast = (breakaway(rate) for rate in (1.0, 5.0, 40.0))
    assert 1.5 > slow > middle > fast > 0.999


def test_hysteresis_before_slip():
    """Section IV.A: a torque that returns to zero leaves an angle, and the loop has an area."""
    arm = turning(1.0, PUBLISHED)
    duration, peak = 4.0, 1.425  # 95 % of static friction

    def triangle(t):
        return peak * (1.0 - abs(1.0 - 2.0 * t / duration))

    result = fa.simulate(
        arm, duration, torque=lambda t: [triangle(t)], breaks=[duration / 2], rate=500.0
    )
    angle = result.joint_angle.values[:, 0]
    reference = lugre(triangle, result.time.values, 1.0, PUBLISHED)[0]
    np.testing.assert_allclose(angle, reference, rtol=0, atol=1e-3 * angle.max())
    # Elastic bristles alone would turn the joint by peak / stiffness and return to zero.
    assert angle.max() > 1.2 * peak / 1e5
    assert angle[-1] > 0.3 * peak / 1e5


def test_lag_behind_the_rate():
    """Section IV.C: friction is larger while the rate increases than while it decreases."""
    arm = turning(1.0, PUBLISHED)
    rate = 1.5e-3, 1.4e-3

    def angle(k):
        turn = 2.0 * np.pi * 5.0
        return lambda t: [
            rate[0] * t + rate[1] * (1.0 - np.cos(turn * t)) / turn,
            rate[0] + rate[1] * np.sin(turn * t),
            rate[1] * turn * np.cos(turn * t),
        ][k]

    prescribed = {1: fa.PrescribedAngle(angle(0), angle(1), angle(2))}
    result = fa.simulate(arm, 1.0, prescribed=prescribed, rate=2000.0)
    joint_rate = result.joint_rate.values[:, 0]
    level = result.torque.values[:, 0] - np.gradient(joint_rate, result.time.values)
    late = result.time.values > 0.6
    rising = np.gradient(joint_rate) > 0.0
    near = late & (np.abs(joint_rate - rate[0]) < 2e-4)
    assert level[near & rising].mean() > level[near & ~rising].mean() + 0.01


# Flexible arms -----------------------------------------------------------------------------------


def flexible(friction=None, **options):
    """Two flexible links; bristles at an elastic joint, a function of the rate at the other."""
    link = fa.Link(length=0.5, mass_per_length=0.4, flexural_rigidity=15.0, modes=2)
    other = fa.Friction(coulomb=0.05, smoothing_rate=0.5)
    first = fa.Joint(
        hub_inertia=0.01, rotor_inertia=1e-4, gear_ratio=20.0, stiffness=300.0, friction=friction
    )
    return fa.Arm(
        links=[link, link],
        joints=[first, fa.Joint(hub_inertia=0.01, friction=other)],
        gravity=(0.0, -9.81),
        **options,
    )


def driven(t):
    return np.array([2.5 * np.cos(9.0 * t), 0.4 * np.sin(14.0 * t)])


@pytest.mark.sampled("linear")
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_flexible_arm(theory):
    """The arm is that without bristles under the torque of bristles integrated beside it."""
    arm = flexible(fa.Friction(**RUBBING, smoothing_rate=1e-4), theory=theory)
    bare = flexible(theory=theory)
    result = fa.simulate(arm, 0.3, torque=driven, rate=200.0, rtol=1e-9, atol=1e-11)
    n, stiffness, damping = bare.dof, RUBBING["bristle_stiffness"], RUBBING["bristle_damping"]

    def slope(t, x):
        q, qd, z = x[:n], x[n:-1], x[-1]
        rate = qd[0]
        sign = np.tanh(rate / 1e-4)  # weight of the two directions
        level = 0.6 - 0.1 * sign + 0.3 * np.exp(-((rate / 0.05) ** 2))
        z_dot = rate - stiffness * abs(rate) * z / level
        torque = driven(t)
        torque[0] -= stiffness * z + damping * z_dot + 0.1 * rate
        return np.concatenate([qd, bare.forward_dynamics(q, qd, torque), [z_dot]])

    times = result.time.values
    limits = {"rtol": 1e-9, "atol": 1e-12, "method": "LSODA", "t_eval": times}
    found = solve_ivp(slope, (0.0, times[-1]), np.zeros(2 * n + 1), **limits).y.T
    scale = np.abs(found[:, :n]).max(axis=0)
    # Tolerances of 1e-9 in each step, over some hundred; the smallest mode has few digits.
    assert (np.abs(result.q.values - found[:, :n]).max(axis=0) < 2e-5 * scale).all()
    assert np.abs(result.bristle_deflection.values[:, 0] - found[:, -1]).max() < 1e-8
    assert (result.bristle_deflection.values[:, 1] == 0.0).all()
    assert (np.diff(np.sign(result.joint_rate.values[:, 0])) != 0).sum() >= 2


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_integral_of_the_deflection_has_no_effect(theory):
    """The coordinate of the additional mode is no displacement: not to the last digit."""
    arm = flexible(fa.Friction(**RUBBING), theory=theory)
    kernels = KernelView(arm.assembly.run_constants)
    random = np.random.default_rng(1)
    state = arm.padded(random.normal(size=(2, arm.dof)))
    state[1, 0, -1] = 0.01
    torque = np.zeros(arm.assembly.bodies)
    before, energy = kernels.forward_dynamics(state, torque).copy(), channels_of(arm, state[None])
    state[0, 0, -1] = 3.0
    assert (kernels.forward_dynamics(state, torque) == before).all()
    moved = channels_of(arm, state[None])
    assert (moved["kinetic_energy"] == energy["kinetic_energy"]).all()
    state[1, 0, -1] = 0.02
    assert (kernels.forward_dynamics(state, torque) != before).any()


def test_deflection_is_part_of_the_error_estimate():
    """The joint has a given motion, so that only the deflection determines the steps."""
    amplitude, turn = 1e-3, 2.0 * np.pi
    motion = fa.PrescribedAngle(
        lambda t: amplitude * (1.0 - np.cos(turn * t)),
        lambda t: amplitude * turn * np.sin(turn * t),
        lambda t: amplitude * turn**2 * np.cos(turn * t),
    )
    result = fa.simulate(turning(), 2.0, prescribed={1: motion}, rate=50.0)

    def slope(t, z):
        rate = motion.rate(t)
        return rate - 5000.0 * abs(rate) * z / (0.5 + 0.3 * np.exp(-((rate / 0.05) ** 2)))

    limits = {"rtol": 1e-10, "atol": 1e-14, "method": "LSODA", "t_eval": result.time.values}
    z = solve_ivp(slope, (0.0, 2.0), [0.0], **limits).y[0]
    # Each of 74 steps may have 1e-9 rad, as the tip is at 1 m; without the deflection in the
    # estimate, 26 steps have an error of 2e-5 rad.
    np.testing.assert_allclose(result.bristle_deflection[:, 0], z, rtol=0, atol=2e-7)


def test_strain_energy_contains_that_of_bristles():
    arm = turning()
    result = fa.simulate(arm, 1.0, torque=[[0.5]] * 2, rate=1.0)
    z = result.bristle_deflection.values[-1, 0]
    assert result.strain_energy.values[-1] == pytest.approx(0.5 * 5000.0 * z * z, rel=1e-9)
    assert result.kinetic_energy.values[-1] < 1e-12


def test_joint_forces_contain_the_torque_of_bristles():
    """At rest the moment of the joint is zero: the bristles transmit the torque of the motor."""
    result = fa.simulate(turning(), 1.0, torque=[[0.5]] * 2, rate=1.0)
    assert result.joint_moment.values[-1, 0] == pytest.approx(0.0, abs=1e-6)
