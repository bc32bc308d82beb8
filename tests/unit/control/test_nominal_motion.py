"""Nominal motions of linear controllers: previewed, recorded, and interpolated over postures."""

import numpy as np
import pytest
from linear_arm import POSTURE, arm_with_gauges

import flexarm as fa
from flexarm.control.design.nominal import Interpolated, PostureGrid

SAMPLE_TIME = 0.002


def test_recorded_run_is_followed_exactly_and_its_end_is_held():
    arm = arm_with_gauges()
    motion = fa.joint_motion(arm, POSTURE, [0.6, 0.6], 0.5)
    planned = fa.simulate(arm, 0.8, torque=fa.rigid_torque(arm, motion), initial=arm.rest(POSTURE))
    controller = fa.LQG(arm, [0.5, 0.75], nominal=planned)
    run = fa.simulate(arm, 0.8, controller=controller, reference=motion)
    # Torques are constant over a millisecond instead of smooth.
    np.testing.assert_allclose(run.tip.values, planned.tip.values, rtol=0, atol=2e-5)


def test_recorded_run_is_cubic_between_its_samples():
    arm = arm_with_gauges()
    motion = fa.joint_motion(arm, POSTURE, [0.6, 0.6], 0.5)
    how = {"torque": fa.rigid_torque(arm, motion), "initial": arm.rest(POSTURE)}
    seldom, often = (fa.simulate(arm, 0.5, rate=rate, **how) for rate in (50.0, 500.0))
    controller = fa.LQG(arm, [0.5, 0.75], nominal=seldom)
    recorded = controller._nominal_motion()
    joints = arm.joint_index
    found = [recorded.at(t, None).q[joints] for t in often.time.values]
    # Error of a cubic through values and rates: fourth derivative times 0.02^4 / 384, for the
    # acceleration of the vibration, up to 200 rad/s^2 at 60 rad/s.
    np.testing.assert_allclose(found, often.q.values[:, joints], rtol=0, atol=3e-4)


def test_runs_that_cannot_be_interpolated_are_refused():
    arm = arm_with_gauges()
    planned = fa.simulate(arm, 0.1, torque=lambda t: [0.1, 0.0], rate=100.0)
    broken = planned.copy(deep=True)
    broken["q"].values[3, 0] = np.nan
    for run in (broken, planned.isel(time=slice(1)), planned.isel(time=[0, 2, 1])):
        with pytest.raises(
            fa.InputError, match="nominal must have at least two samples, all finite"
        ):
            fa.LQG(arm, [0.5, 0.75], nominal=run)._nominal_motion()


class Sweep:
    """A reference that turns the joints at a constant rate until its end, and then stops."""

    end_time = 0.02

    def joint_angle(self, t):
        return np.array([0.4, 0.9]) + t

    def joint_rate(self, t):
        return np.ones(2)

    def joint_acceleration(self, t):
        return np.zeros(2)


def test_reference_rests_after_its_end():
    controller = fa.LQG(arm_with_gauges(), POSTURE, sample_time=0.01)
    motion, reference = controller._nominal_motion(), Sweep()
    found = [motion.at(0.01 * k, reference) for k in range(5)]
    joints = controller.arm.joint_index
    np.testing.assert_array_equal([n.qd[joints[0]] for n in found], [1.0, 1.0, 1.0, 0.0, 0.0])
    np.testing.assert_allclose([n.angle[0] for n in found], [0.4, 0.41, 0.42, 0.42, 0.42])


def test_long_preview_ends_at_the_first_node_after_its_time():
    """A long preview groups samples, so that `update` stays cheap."""
    controller = fa.LQG(arm_with_gauges(), POSTURE, sample_time=SAMPLE_TIME, preview=0.5)
    samples = round(0.5 / SAMPLE_TIME)
    assert controller._stride > 1
    assert samples <= controller._previewed < samples + controller._stride


def test_grid_interpolates_linear_functions_exactly_and_is_constant_outside():
    grid = PostureGrid(np.zeros(3), [[-1.0, 0.5, 2.0], None, [0.0, 1.0]])
    assert grid.postures.shape == (6, 3)
    values = Interpolated(grid, [[p, np.array([[p[0] - 3.0 * p[2]]])] for p in grid.postures])
    for angle in ([-0.3, 5.0, 0.25], [1.7, 0.0, 0.9], [0.5, 0.0, 1.0]):
        values.at(np.array(angle))
        np.testing.assert_allclose(values.arrays[0], [angle[0], 0.0, angle[2]], atol=1e-15)
        np.testing.assert_allclose(values.arrays[1], [[angle[0] - 3.0 * angle[2]]], atol=1e-15)
    values.at(np.array([-9.0, 0.0, 9.0]))
    np.testing.assert_allclose(values.arrays[0], [-1.0, 0.0, 1.0], atol=1e-15)
