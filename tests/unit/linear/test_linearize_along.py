"""The matrices of the separation against differences of the full dynamics, and their export."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain

# Central differences of second order over 1e-5: their own error is near 1e-9 of the entries.
STEP, CLOSE = 1e-5, 1e-7


def an_arm(**fields):
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.6, "elements": 2}
    joints = [0.1, {"mass": 0.5, "damping": 0.3}]
    return chain((1.4, 1.0), joints, gravity=(0.0, -9.81), **rod, **fields)


def a_motion(arm, **fields):
    return fa.joint_motion(arm, start=[0.2, -0.5], end=[1.0, 0.4], duration=0.7, **fields)


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_matrices_are_the_derivatives_of_the_inverse_dynamics(theory):
    arm = an_arm(theory=theory)
    model = fa.linearize_along(arm, a_motion(arm), times=[0.31])
    ref = [part[0] for part in (model.reference.q, model.reference.qd, model.reference.qdd)]
    exact = [part[0] for part in (model.deviation.K, model.deviation.D, model.deviation.M)]
    for level in range(3):
        for j in range(arm.dof):
            moved = [[part.copy() for part in ref] for _ in range(2)]
            moved[0][level][j] += STEP
            moved[1][level][j] -= STEP
            up, down = (arm.inverse_dynamics(*m) for m in moved)
            scale = 1.0 + np.max(np.abs(exact[level][:, j]))
            wanted = (up - down) / (2.0 * STEP)
            np.testing.assert_allclose(exact[level][:, j], wanted, rtol=0, atol=CLOSE * scale)


def test_state_space_form():
    arm = an_arm()
    model = fa.linearize_along(arm, a_motion(arm), rate=20.0)
    k, n = arm.dof, len(model.time)
    assert model.A.shape == (n, 2 * k, 2 * k)
    assert model.B.shape == (n, 2 * k, 2)
    i = 7
    rng = np.random.default_rng(1)
    dq, dqd, u = rng.standard_normal(k), rng.standard_normal(k), rng.standard_normal(2)
    M, D, K, r, _ = (part[i] for part in model.deviation)
    force = r.copy()
    force[arm.joint_index] += u
    wanted = np.concatenate([dqd, np.linalg.solve(M, force - D @ dqd - K @ dq)])
    found = model.A[i] @ np.concatenate([dq, dqd]) + model.B[i] @ u + model.f[i]
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * np.abs(wanted).max())


def test_reference_is_that_of_the_rigid_arm():
    arm = an_arm()
    motion = a_motion(arm)
    model = fa.linearize_along(arm, motion, rate=50.0)
    np.testing.assert_allclose(
        model.reference.torque, fa.rigid_torque(arm, motion)(model.time), atol=1e-10
    )
    assert model.time[0] == 0.0
    assert model.time[-1] == 0.7
    np.testing.assert_array_equal(model.deviation.r[:, arm.joint_index], 0.0)


@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")  # bent by more than 10 %
def test_quasi_static_deflection_at_rest_is_the_sag():
    """At rest under gravity it equals the equilibrium except for quadratic terms."""
    arm = an_arm()
    motion = a_motion(arm, start_time=1.0)
    model = fa.linearize_along(arm, motion, times=[0.0])
    q = fa.equilibrium(arm, motion.joint_angle(0.0)).q
    bent = q - arm.rest(motion.joint_angle(0.0))
    found = model.quasi_static()[0]
    np.testing.assert_allclose(found, bent, rtol=0, atol=0.02 * np.abs(bent).max())


def test_evaluation_at_any_time_and_export(tmp_path):
    arm = an_arm()
    model = fa.linearize_along(arm, a_motion(arm), joints="locked", rate=100.0)
    assert model.kept.size == arm.dof - 2
    assert model.B.shape[2] == 0
    other = model.at([0.123, 0.5])
    np.testing.assert_array_equal(other.at(model.time).A, model.A)
    model.save(tmp_path / "model.NPZ")
    with np.load(tmp_path / "model.NPZ") as stored:
        np.testing.assert_array_equal(stored["A"], model.A)
        np.testing.assert_array_equal(stored["time"], model.time)
    data = fa.linearize_along(arm, a_motion(arm), rate=100.0).to_dataset()
    assert data.A.dims == ("time", "state", "state_too")
    assert list(data.input.values) == ["torque_1", "torque_2"]
    middle = data.A.interp(time=0.123)
    exact = fa.linearize_along(arm, a_motion(arm), times=[0.123]).A[0]
    # Linear interpolation over 10 ms of a motion of 0.7 s.
    np.testing.assert_allclose(middle, exact, rtol=0, atol=0.01 * np.abs(exact).max())
