"""Prescribed performance: the law written out, its bounds, and its steady error."""

import numpy as np
import pytest
from scipy.optimize import brentq
from test_position_laws import TICK, arm, readings

import flexarm as fa
from flexarm.control.hardware.measurement import Measurement


class Steady:
    def joint_angle(self, t):
        return np.array([0.3, -0.2])

    def joint_rate(self, t):
        return np.array([1.0, 2.0])

    def joint_acceleration(self, t):
        return np.zeros(2)


def test_law_written_out_for_single_numbers():
    """Bechlioulis and Rovithakis (2014): logarithms of the errors relative to their bounds."""
    b, d, end, start, rate_bound, decay = (3.0, 5.0), (0.4, 0.2), 0.5, 2.5, (4.0, 9.0), 3.0
    controller = fa.PrescribedPerformance(
        b, d, end, rate_bound, start_bound=start, decay=decay, sample_time=TICK
    )
    controller.reset()
    beyond = 0
    for k, stated in enumerate(readings()):
        found = controller.update(k * TICK, stated, Steady())
        bound = end + (start - end) * np.exp(-decay * k * TICK)
        np.testing.assert_allclose(controller.angle_bound(k * TICK), [bound], rtol=1e-12)
        for j in range(2):
            ratio = ([0.3, -0.2][j] - stated.joint_angle[j]) / bound
            wanted = [1.0, 2.0][j] + b[j] * bound * extended(transformed, ratio)
            ratio = (wanted - stated.joint_rate[j]) / rate_bound[j]
            beyond += abs(ratio) > 0.9
            torque = d[j] * rate_bound[j] * extended(with_slope, ratio)
            assert found[j] == pytest.approx(torque, rel=1e-6)
    assert 5 < beyond < 75  # both cases occur


def transformed(x):
    return 0.5 * np.log((1 + x) / (1 - x))


def with_slope(x):
    return transformed(x) / (1 - x**2)


def extended(function, x, largest=20.0):
    """Continue a function as a line from where its slope, by differences, is ``largest``."""

    def slope(x):
        return (function(x + 1e-5) - function(x - 1e-5)) / 2e-5

    end = brentq(lambda x: slope(x) - largest, 0.0, 0.99)
    near = max(-end, min(end, x))
    return function(near) + largest * (x - near)


def inverse(function, value):
    return brentq(lambda x: extended(function, x) - value, -5.0, 5.0)


def test_small_errors_give_the_torque_of_joint_pd():
    controller = fa.PrescribedPerformance(5.0, 2.0, 10.0, 100.0, feedforward=lambda t: [1.0, -1.0])
    other = fa.JointPD(10.0, 2.0, feedforward=lambda t: [1.0, -1.0])
    reading = Measurement(joint_angle=np.array([0.301, -0.2]), joint_rate=np.array([1.01, 1.98]))
    found, wanted = (each.update(0.0, reading, Steady()) for each in (controller, other))
    np.testing.assert_allclose(found, wanted, rtol=1e-5)  # cubic terms of errors below 1e-3


@pytest.mark.thorough
def test_angle_stays_within_its_bound_for_an_unknown_payload_and_friction():
    """Joint PD with the gains of small errors leaves the bound."""
    model = arm(gravity=(0.0, -2.0)).rigid()
    friction = [fa.Joint(hub_inertia=0.05, friction=fa.Friction(coulomb=0.5))] * 2
    heavy = fa.Arm(model.spec.replace(joints=friction, payload=fa.Payload(mass=1.0)))
    motion = fa.joint_motion(heavy, [0.2, -0.4], [0.9, 0.5], 2.0)
    start = heavy.rest([0.25, -0.43])
    controller = fa.PrescribedPerformance(
        8.0, [40.0, 12.0], 0.02, 2.0, start_bound=0.1, decay=4.0, sample_time=2e-4
    )
    used = []
    for each in (controller, fa.JointPD([320.0, 96.0], [40.0, 12.0])):
        run = fa.simulate(heavy, 2.5, controller=each, reference=motion, initial=start, rate=500.0)
        error = run.joint_angle.values - motion.joint_angle(run.time.values)
        used.append(np.max(abs(error) / controller.angle_bound(run.time.values)))
    assert used[0] < 1.0
    assert used[1] > 1.3


def held(bound, **options):
    """A stiff arm held against gravity from 0.1 rad beside the reference."""
    plant = arm(gravity=(0.0, -3.0)).rigid()
    law = fa.PrescribedPerformance(6.0, [3.0, 1.5], bound, 1.5, sample_time=0.002, **options)
    motion = fa.joint_motion(plant, [0.3, 0.2], [0.3, 0.2], 1.0)
    start = plant.rest([0.4, 0.2])
    return fa.simulate(plant, 0.2, controller=law, reference=motion, initial=start, rate=100.0)


def test_samples_outside_the_bound_are_counted_and_warned_of():
    assert held(0.2).bound_exceeded == 0
    with pytest.warns(fa.FlexarmWarning, match=r"outside its bound at \d+ samples: raise"):
        run = held(0.001, start_bound=0.11, decay=50.0)
    assert 0 < run.bound_exceeded < run.controller_calls
    words = r"first angle error is 2 times its bound.*raise start_bound"
    with pytest.warns(fa.FlexarmWarning, match=words):
        run = held(0.05)
    assert run.bound_first_ratio == pytest.approx(2.0)


def test_run_that_fails_names_a_first_error_outside_the_start_bound():
    plant = arm()
    law = fa.PrescribedPerformance(2.0, [0.05, 0.02], 1e-3, 0.1, gain_limit=1e4)
    motion = fa.joint_motion(plant, [0.0, 0.0], [0.5, 0.5], 1.0)
    start = plant.rest([1.0, 0.0])
    words = r"The first angle error is 1e\+03 times its bound.*The sampled loop is unstable"
    with pytest.warns(fa.UnstableLoopWarning), pytest.raises(fa.SimulationError, match=words):
        fa.simulate(plant, 1.0, controller=law, reference=motion, initial=start)


def test_analysis_of_the_loop_with_a_bound_of_its_increment():
    """Memory and readings are varied by 1e-5, which must not make the bound zero."""
    law = fa.PrescribedPerformance(6.0, [0.3, 0.1], 1e-5, 1.5)
    assert np.isfinite(fa.loop_margins(law, arm(), [[0.3, -0.2]]).growth.values).all()


def test_steady_error_under_a_constant_torque():
    """The error at which the law returns the gravity torque, in closed form."""
    plant = arm(gravity=(0.0, -3.0)).rigid()
    controller = fa.PrescribedPerformance(6.0, [3.0, 1.5], 0.1, 1.5)
    run = fa.simulate(plant, 8.0, controller=controller, initial=plant.rest([0.3, 0.2]), rate=20.0)
    angle = run.joint_angle.values[-1]
    weight = plant.bias_force(angle, np.zeros(2))
    for j, damping in enumerate((3.0, 1.5)):
        rate = 1.5 * inverse(with_slope, weight[j] / (damping * 1.5))
        wanted = 0.1 * inverse(transformed, rate / 0.6)
        assert [0.3, 0.2][j] - angle[j] == pytest.approx(wanted, rel=1e-4)
        assert abs(wanted) > 0.02


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"bound": 0.0}, "bound must be greater than 0"),
        ({"rate_bound": -1.0}, "rate_bound must be greater than 0"),
        ({"start_bound": [0.2, 0.05]}, "start_bound must be at least bound"),
        ({"start_bound": [0.2] * 3, "bound": [0.1] * 2}, "start_bound must have length 2"),
        ({"gain_limit": 1.0}, "gain_limit must be at least 1.01"),
        ({"decay": -1.0}, "decay must be at least 0"),
        ({"feedforward": 3.0}, "feedforward must be a function"),
    ],
)
def test_wrong_arguments_are_rejected(options, words):
    given = {"bandwidth": 3.0, "damping": 1.0, "bound": 0.1, "rate_bound": 1.0, **options}
    with pytest.raises(fa.InputError, match=words):
        fa.PrescribedPerformance(**given)
