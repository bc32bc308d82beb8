"""Loads and base accelerations over time: work, closed forms, and their channels."""

import numpy as np
import pytest

import flexarm as fa

ROD = {"flexural_rigidity": 20.0, "mass_per_length": 0.5}
HOLD = fa.PrescribedAngle(lambda t: 0.0, lambda t: 0.0, lambda t: 0.0)
FINE = {"rtol": 1e-10, "atol": 1e-12}


def clamped(**fields):
    return fa.Arm(links=[fa.Link(length=1.0, elements=3, **ROD)], **fields)


def modal_answer(arm, force, omega, times):
    """Return coordinates (times, modes) of modes of unit mass, from rest, under force * sin(omega
    t)."""
    w = np.sqrt(arm.assembly.links[0].w2)
    beat = np.sin(omega * times[:, None]) - omega / w * np.sin(w * times[:, None])
    return force * beat / (w**2 - omega**2)


OMEGA = 9.0


def sine(t):
    return float(np.sin(OMEGA * t))


class TestClosedForms:
    """A linear link with a locked root consists of one oscillator for each mode."""

    @pytest.mark.parametrize("segment", [(0.0, 1.0), (0.25, 0.8)])
    def test_distributed_load(self, segment):
        arm = clamped()
        load = fa.Load(1, (3.0, 2.0), spread=segment, factor=sine)
        result = fa.simulate(arm, 0.5, loads=[load], prescribed={1: HOLD}, rate=200, **FINE)
        link = arm.assembly.links[0]
        node, weight = np.polynomial.legendre.leggauss(30)
        x = segment[0] + (segment[1] - segment[0]) * (node + 1) / 2
        force = 2.0 * (weight * (segment[1] - segment[0]) / 2) @ link.deflection(x)
        exact = modal_answer(arm, force, OMEGA, result.time.values)
        # Thirty Gauss points across the nodes of a mesh whose shapes have one continuous
        # derivative.
        np.testing.assert_allclose(
            result.q.values[:, 1:], exact, rtol=0, atol=1e-6 * abs(exact).max()
        )

    def test_force_and_moment(self):
        arm = clamped()
        load = fa.Load(1, (3.0, 2.0), 0.7, station=0.6, factor=sine)
        result = fa.simulate(arm, 0.5, loads=[load], prescribed={1: HOLD}, rate=200, **FINE)
        link = arm.assembly.links[0]
        force = 2.0 * link.deflection([0.6])[0] + 0.7 * link.slope([0.6])[0]
        exact = modal_answer(arm, force, OMEGA, result.time.values)
        np.testing.assert_allclose(
            result.q.values[:, 1:], exact, rtol=0, atol=1e-8 * abs(exact).max()
        )

    def test_accelerated_base(self):
        arm = clamped()
        result = fa.simulate(
            arm,
            0.5,
            base_acceleration=lambda t: (5.0, 4.0 * np.sin(OMEGA * t)),
            prescribed={1: HOLD},
            rate=200,
            **FINE,
        )
        exact = modal_answer(arm, -4.0 * arm.assembly.links[0].S, OMEGA, result.time.values)
        np.testing.assert_allclose(
            result.q.values[:, 1:], exact, rtol=0, atol=1e-8 * abs(exact).max()
        )


def test_upward_acceleration_of_the_base_equals_gravity():
    arm = fa.Arm(links=[fa.Link(length=1.0, elements=2, **ROD)] * 2, theory="second_order")
    heavy = fa.Arm(arm.spec.replace(gravity=(0.0, -9.81)))
    start = arm.rest([-0.4, 0.3])
    lifted = fa.simulate(arm, 0.5, initial=start, base_acceleration=(0.0, 9.81), rate=100)
    fallen = fa.simulate(heavy, 0.5, initial=start, rate=100)
    # The first step follows from a frequency that gravity changes slightly.
    np.testing.assert_allclose(lifted.q.values, fallen.q.values, rtol=0, atol=1e-10)
    by_function = fa.simulate(
        arm, 0.5, initial=start, base_acceleration=lambda t: (0.0, 9.81), rate=100
    )
    # Interpolated by cubics to 1e-9 of its size.
    np.testing.assert_allclose(by_function.q.values, fallen.q.values, rtol=0, atol=1e-7)


def test_free_fall_of_the_base_removes_the_weight():
    arm = fa.Arm(links=[fa.Link(length=1.0, elements=2, **ROD)], gravity=(1.0, -9.81))
    result = fa.simulate(arm, 0.3, base_acceleration=(1.0, -9.81), rate=100)
    np.testing.assert_array_equal(result.q.values, 0.0)
    np.testing.assert_allclose(result.joint_force.values, 0.0, atol=1e-12)


def test_steps_end_at_jumps_of_a_factor():
    """A force that acts from 0.1 to 0.2 s gives a rigid arm one angular impulse."""
    link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    arm = fa.Arm(links=[link])
    load = fa.Load(1, (0.0, 2.0), frame="link", factor=lambda t: float(0.1 <= t < 0.2))
    result = fa.simulate(arm, 0.5, loads=[load], rate=100)
    assert result.joint_rate.values[-1, 0] == pytest.approx(0.2, rel=1e-9)
    assert result.joint_angle.values[-1, 0] == pytest.approx(0.01 + 0.2 * 0.3, rel=1e-9)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_work_of_loads_is_the_change_of_energy(theory):
    """Force times the velocity of its point, and moment times the rate of its section."""
    links = [
        fa.Link(length=1.0, elements=2, segments=2, **ROD),
        fa.Link(length=0.8, elements=1, **ROD),
    ]
    arm = fa.Arm(links=links, theory=theory)
    loads = [
        fa.Load(1, (0.4, -0.6), 0.1, factor=lambda t: float(np.cos(4 * t))),
        fa.Load(2, (0.3, 0.5), -0.05, frame="link", factor=lambda t: 1.0 + t),
    ]
    result = fa.simulate(arm, 0.4, loads=loads, rate=4000, **FINE)
    t = result.time.values
    tips = np.array([arm.shape(q, 2)[:, 1] for q in result.q.values])  # (times, links, 2)
    velocity = np.gradient(tips, t, axis=0, edge_order=2)
    angle = result.link_angle.values + result.link_tip_slope.values
    turning = np.gradient(angle, t, axis=0, edge_order=2)
    root = result.link_angle.values[:, 1]
    c, s = np.cos(root), np.sin(root)
    first = np.cos(4 * t)[:, None] * [0.4, -0.6]
    second = (1.0 + t)[:, None] * np.stack([0.3 * c - 0.5 * s, 0.3 * s + 0.5 * c], axis=1)
    power = np.sum(first * velocity[:, 0], axis=1) + 0.1 * np.cos(4 * t) * turning[:, 0]
    power += np.sum(second * velocity[:, 1], axis=1) - 0.05 * (1.0 + t) * turning[:, 1]
    energy = (result.kinetic_energy + result.strain_energy).values
    work = np.concatenate([[0.0], np.cumsum((power[1:] + power[:-1]) / 2 / 4000)])
    assert energy[-1] > 0.1
    # Differences and the trapezoidal rule at 4 kHz.
    np.testing.assert_allclose(energy, work, rtol=0, atol=1e-3 * energy.max())


def test_constant_tip_force_equals_a_load():
    arm = clamped()
    by_tip = fa.simulate(arm, 0.2, tip_force=(1.0, 2.0, 0.3), rate=100)
    by_load = fa.simulate(arm, 0.2, loads=[fa.Load(1, (1.0, 2.0), 0.3)], rate=100)
    np.testing.assert_array_equal(by_tip.q.values, by_load.q.values)


def test_load_with_a_controller():
    """PD control against a load has a steady error of load / gain."""
    link = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    arm = fa.Arm(links=[link])
    hold = fa.joint_motion(arm, [0.0], [0.0], 1.0)
    controller = fa.JointPD([50.0], [14.0], 1e-3)
    load = fa.Load(1, (0.0, 5.0), frame="link")
    result = fa.simulate(arm, 3.0, controller=controller, reference=hold, loads=[load], rate=100)
    assert result.joint_angle.values[-1, 0] == pytest.approx(0.1, rel=1e-4)
