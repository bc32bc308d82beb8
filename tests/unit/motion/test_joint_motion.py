"""Joint motions go straight from one posture to another."""

import numpy as np
from motion_checks import Links

from flexarm.motion import joint_motion

# In floating point -3 + (-0.9 - -3) differs from -0.9, so an exact end needs care.
START, END = np.array([-3.0, -0.7]), np.array([-0.9, 2.2])


def test_ends_are_exact_to_the_bit():
    motion = joint_motion(Links(), START, END, 0.3)
    assert motion.joint_angle(0.0).tolist() == START.tolist()
    assert motion.joint_angle(0.3).tolist() == END.tolist()


def test_joints_have_equal_path_fractions():
    motion = joint_motion(Links(), START, END, 2.0)
    np.testing.assert_allclose(motion.joint_angle(1.0), (START + END) / 2, rtol=0, atol=1e-15)
    # The quintic's largest rate is 15/8 of the mean, its largest acceleration 10/sqrt(3).
    np.testing.assert_allclose(motion.joint_rate(1.0), 15 / 8 * (END - START) / 2, rtol=1e-14)
    at = 1.0 - 1.0 / np.sqrt(3.0)
    peak = 10 / np.sqrt(3) * (END - START) / 4
    np.testing.assert_allclose(motion.joint_acceleration(at), peak, rtol=1e-13)


def test_tip_is_that_of_the_rigid_arm():
    motion = joint_motion(Links((2.0, 1.0)), [0.0, 0.0], [0.0, np.pi / 2], 1.0)
    np.testing.assert_allclose(motion.tip([0.0, 1.0]), [[3.0, 0.0], [2.0, 1.0]], rtol=0, atol=1e-15)


def test_start_and_end_may_be_equal():
    motion = joint_motion(Links(), START, START, 1.0)
    assert np.all(motion.joint_rate(np.linspace(0, 1, 9)) == 0.0)


def test_motion_of_extreme_duration_is_at_rest():
    # The square of its duration is beyond the largest float.
    angle, rate, acceleration = joint_motion(Links([1.0]), [0.0], [1.0], 1e300).state([0.0, 1.0])
    np.testing.assert_array_equal(angle, [[0.0], [0.0]])
    np.testing.assert_array_equal(acceleration, [[0.0], [0.0]])
    assert np.all(np.abs(rate) < 1e-299)
