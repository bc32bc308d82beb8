"""Scheduled gains of LQG against the optimum along a motion, from the Riccati recursion."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from page_scripts import script

STUDY = script("measure_schedule")


def test_the_model_along_a_motion_is_that_of_the_design_at_rest():
    arm = STUDY.arm_of()
    motion, acceptable = STUDY.cases(arm)["elbow"]
    item = STUDY.fa.LQG(
        arm, motion.joint_angle(0.0), acceptable=acceptable, sample_time=4e-3
    ).designs[0]
    torque = np.diag(item.torque_weight) ** -0.5
    along = STUDY.AlongMotion(arm, motion, acceptable, torque, 4e-3)
    # Both differentiate exactly, and sample with the same matrix exponential.
    np.testing.assert_allclose(along.A[0], item.A, rtol=1e-7, atol=1e-7)
    np.testing.assert_allclose(along.B[0], item.B, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(along.Q[0], item.weight, rtol=1e-9, atol=1e-6)
    fixed = solve_discrete_are(along.A[-1], along.B[-1], along.Q[-1], along.R)
    _, _, costs = along.optimum()
    # The recursion from the stationary cost stays there while the arm rests.
    np.testing.assert_allclose(costs[-50], fixed, rtol=1e-6, atol=1e-6 * fixed.max())


@pytest.mark.sampled("elbow-near1")
@pytest.mark.parametrize(("name", "near"), [("line", (0.005, 0.02)), ("elbow", (0.04, 0.03))])
def test_scheduled_gains_are_near_the_optimum_and_better_than_one_posture(name, near):
    """The bounds are about 1.5 times the excess costs on the page, for a longer sample time."""
    found = STUDY.measure(name, sample_time=2e-3)
    pushed, moved, _ = found["schedule"]
    assert -1e-9 < pushed < near[0]
    assert -1e-9 < moved < near[1]
    assert found["one posture"][0] > 3.0 * pushed
    assert found["one posture"][1] > moved
    assert found["optimum"][:2] == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize("case", ["line", "elbow"])
def test_well_posed_designs_do_not_depend_on_rounding(case):
    """SciPy's ordering of eigenvalues alone failed at some of these sample times."""
    arm = STUDY.arm_of()
    motion, acceptable = STUDY.cases(arm)[case]
    for sample_time in np.linspace(4.05e-3, 4.1e-3, 11):
        controller = STUDY.fa.LQG(
            arm, motion.joint_angle(0.0), acceptable=acceptable, sample_time=sample_time
        )
        item = controller.designs[0]
        loop = item.A - item.B @ item.gain[:, : len(item.A)]
        assert np.max(np.abs(np.linalg.eigvals(loop))) < 1.0
