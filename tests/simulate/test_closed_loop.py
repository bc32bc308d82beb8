"""The loop of controller and arm against an independent one, and its accuracy."""

import numpy as np
import pytest
import threadpoolctl
from scipy.integrate import solve_ivp

import flexarm as fa
from arms import chain, unit_link
from controllers import Plain
from flexarm.base.processes import single_threaded_algebra
from oracles.rigid_double_pendulum import RigidDoublePendulum

LENGTH, MASS = (0.8, 0.6), (0.9, 0.5)
GAINS = np.array([20.0, 8.0]), np.array([2.0, 0.8])
SAMPLE_TIME = 0.005


def rigid_arm():
    links = [
        fa.Link(length=length, mass_per_length=mass / length, flexible=False)
        for length, mass in zip(LENGTH, MASS, strict=True)
    ]
    return fa.Arm(links=links, gravity=(0.0, -9.81))


def flexible_arm(**options):
    rod = {"flexural_rigidity": [40.0, 25.0], "mass_per_length": [0.5, 0.4], "elements": 1}
    return chain((0.8, 0.6), [0.05, {"hub_inertia": 0.03, "mass": 0.2}], **rod, **options)


def test_rigid_loop_equals_an_independent_integration():
    """SciPy between sample times, with the equations of the pendulum and PD written out."""
    arm = rigid_arm()
    motion = fa.joint_motion(arm, [0.3, -0.5], [1.2, 0.4], 0.5)
    controller = fa.JointPD(*GAINS, sample_time=SAMPLE_TIME)
    result = fa.simulate(
        arm, 0.8, controller=controller, reference=motion, rate=200.0, rtol=1e-10, atol=1e-12
    )
    pendulum = RigidDoublePendulum(length=LENGTH, mass=MASS, gravity=(0.0, -9.81))
    state, wanted = np.array([0.3, -0.5, 0.0, 0.0]), []
    for tick in range(161):
        wanted.append(state)
        t = tick * SAMPLE_TIME
        error = motion.joint_angle(t) - state[:2]
        torque = GAINS[0] * error + GAINS[1] * (motion.joint_rate(t) - state[2:])

        def slope(_, y, torque=torque):
            return np.concatenate([y[2:], pendulum.acceleration(y[:2], y[2:], torque)])

        run = solve_ivp(slope, (0.0, SAMPLE_TIME), state, "DOP853", rtol=1e-12, atol=1e-13)
        state = run.y[:, -1]
    found = np.concatenate([result.joint_angle.values, result.joint_rate.values], axis=1)
    # The tolerance per step over 160 sample times.
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-8)


def test_flexible_loop_equals_open_loop_runs_of_one_sample_time_each():
    """Each run starts at the end of the previous one."""
    arm = flexible_arm(theory="second_order")
    motion = fa.joint_motion(arm, [0.3, -0.5], [0.6, -0.1], 0.1)
    controller = fa.JointPD(*GAINS, sample_time=0.01)
    tight = {"rtol": 1e-10, "atol": 1e-12}
    result = fa.simulate(arm, 0.15, controller=controller, reference=motion, rate=100.0, **tight)
    q, qd = arm.rest([0.3, -0.5]), np.zeros(arm.dof)
    for tick in range(15):
        t = tick * 0.01
        torque = GAINS[0] * (motion.joint_angle(t) - arm.joint_angles(q))
        torque = torque + GAINS[1] * (motion.joint_rate(t) - arm.joint_angles(qd))
        np.testing.assert_allclose(result.torque.values[tick], torque, rtol=0, atol=1e-6)
        piece = fa.simulate(
            arm,
            0.01,
            torque=np.array([torque]),
            initial=q,
            initial_rate=qd,
            rate=100.0,
            torque_interpolation="hold",
            **tight,
        )
        q, qd = piece.q.values[-1], piece.qd.values[-1]
    np.testing.assert_allclose(result.q.values[-1], q, rtol=0, atol=1e-8)
    np.testing.assert_allclose(result.qd.values[-1], qd, rtol=0, atol=1e-6)


def test_pd_brings_a_flexible_arm_to_its_goal():
    arm = flexible_arm()
    motion = fa.joint_motion(arm, [0.0, 0.0], [1.0, -0.7], 1.0)
    result = fa.simulate(arm, 6.0, controller=fa.JointPD(*GAINS), reference=motion, rate=100.0)
    np.testing.assert_allclose(result.joint_angle.values[-1], [1.0, -0.7], atol=1e-3)
    np.testing.assert_allclose(result.joint_rate.values[-1], 0.0, atol=1e-2)
    tip = arm.tip(arm.rest([1.0, -0.7]))[:2]
    np.testing.assert_allclose(result.tip.values[-1], tip, atol=2e-3)
    energy = (result.kinetic_energy + result.strain_energy).values
    assert energy[-1] < 1e-3 * energy.max()


def test_feedforward_of_rigid_torque_reduces_the_error():
    arm = flexible_arm()
    motion = fa.joint_motion(arm, [0.0, 0.0], [1.0, -0.7], 1.0)
    errors = []
    for feedforward in (None, fa.rigid_torque(arm, motion)):
        controller = fa.JointPD(*GAINS, feedforward=feedforward)
        result = fa.simulate(arm, 1.0, controller=controller, reference=motion, rate=100.0)
        wanted = motion.joint_angle(result.time.values)
        errors.append(abs(result.joint_angle.values - wanted).max())
    assert errors[1] < 0.2 * errors[0]


@pytest.mark.parametrize(
    ("torque", "found"),
    [
        ([0.3], r"shape \(2,\), got numbers of shape \(1,\)"),
        (0.3, r"shape \(2,\), got a number"),
        ([0.3, np.nan], "finite"),
    ],
)
def test_feedforward_with_a_torque_for_each_joint(torque, found):
    """Without the check, one torque would act on all joints; also inside another controller."""
    arm = flexible_arm()
    inner = fa.JointPD(*GAINS, feedforward=lambda t: torque, sample_time=SAMPLE_TIME)
    shaped = fa.LoopShaping(arm.rigid(), feedforward=lambda t: torque, sample_time=SAMPLE_TIME)
    for controller in (inner, fa.DisturbanceObserver(arm, inner, 2.0), shaped):
        with pytest.raises(fa.InputError, match=rf"feedforward\(0.0025\).* must be .*{found}"):
            fa.simulate(arm, 0.01, controller=controller)


def test_plant_is_simulated_instead_of_the_believed_arm():
    """The controller is designed for a rigid arm and drives the flexible one."""
    plant = flexible_arm()
    believed = plant.rigid()
    motion = fa.joint_motion(believed, [0.0, 0.0], [0.1, 0.1], 0.3)
    controller = fa.JointPD(*GAINS, feedforward=fa.rigid_torque(believed, motion))
    result = fa.simulate(believed, 0.4, controller=controller, reference=motion, plant=plant)
    assert result.sizes["coordinate"] == plant.dof
    assert float(result.strain_energy.max()) > 0.0
    direct = fa.simulate(plant, 0.4, controller=controller, reference=motion)
    np.testing.assert_array_equal(result.q.values, direct.q.values)
    with pytest.raises(fa.InputError, match="plant"):
        fa.simulate(rigid_arm(), 0.1, controller=controller, plant=one_link())


def one_link():
    return fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])


def test_without_a_reference_the_initial_angles_are_held():
    arm = rigid_arm()
    level = fa.Arm(arm.spec.model_copy(update={"gravity": (0.0, 0.0)}))
    result = fa.simulate(
        level, 8.0, controller=fa.JointPD(*GAINS), initial=[0.4, 0.9], initial_rate=[1.0, -1.0]
    )
    np.testing.assert_allclose(result.joint_angle.values[-1], [0.4, 0.9], atol=1e-4)


@pytest.mark.thorough
def test_run_continues_when_all_values_underflow():
    """Angles decay by exp(-10 t) until squares underflow, and so do the errors of a step."""
    arm = one_link()

    class Zero:
        def joint_angle(self, t):
            return np.zeros(1)

        joint_rate = joint_acceleration = joint_angle

    controller = fa.JointPD(100.0, 15.0, sample_time=0.01)
    result = fa.simulate(arm, 150.0, controller=controller, reference=Zero(), initial=[0.5], rate=1)
    assert result.sizes["time"] == 151
    assert abs(result.joint_angle.values[-1, 0]) < 1e-200


def test_sample_times_that_do_not_divide_the_duration():
    arm = rigid_arm()
    result = fa.simulate(
        arm, 0.1, controller=fa.JointPD(*GAINS, sample_time=0.03), initial=[0.1, 0.1], rate=1000.0
    )
    assert result.sizes["time"] == 101
    changes = np.flatnonzero(np.any(np.diff(result.torque.values, axis=0) != 0.0, axis=1)) + 1
    np.testing.assert_array_equal(changes, [30, 60, 90])


def test_unstable_loop_is_reported_with_its_partial_result():
    """The gains are far too large for the sample time."""
    controller = fa.JointPD(1e6, 1e5, sample_time=0.02)
    with pytest.warns(fa.UnstableLoopWarning), pytest.raises(fa.SimulationError) as caught:
        fa.simulate(
            flexible_arm(), 60.0, controller=controller, initial_rate=flexible_arm().rest([1.0, 0])
        )
    error = caught.value
    assert 0.0 < error.time < 60.0
    assert error.reason
    assert error.hint.startswith("The sampled loop is unstable")
    assert error.result.sizes["time"] >= 1
    assert np.all(np.isfinite(error.result.q.values))
    assert np.all(np.isfinite(error.state[0]))


def threads_of_algebra():
    """The numbers of threads of the libraries of linear algebra in this process."""
    pools = threadpoolctl.ThreadpoolController().select(user_api="blas").info()
    if not pools:
        pytest.skip("this library of linear algebra cannot be asked for its threads")
    return {pool["num_threads"] for pool in pools}


@pytest.mark.parametrize("clock", [None, False])
def test_matrix_products_of_controllers_use_one_thread(clock):
    """``clock``: of ``realtime``, None for ``simulate``."""
    during = set()

    def torque(t, measurement, reference):
        during.update(threads_of_algebra())
        return [0.0]

    arm, law = unit_link(), Plain(torque)
    with threadpoolctl.threadpool_limits(2, "blas"):
        if clock is None:
            fa.simulate(arm, 0.03, controller=law)
        else:
            fa.realtime(fa.Plant(arm, sample_time=0.01), law, 0.03, clock=clock)
        assert threads_of_algebra() == {2}
    assert during == {1}


def test_overlapping_loops_restore_the_number_of_threads():
    """As those of two threads of a program, of which the first ends before the second."""
    with threadpoolctl.threadpool_limits(2, "blas"):
        first, second = single_threaded_algebra(), single_threaded_algebra()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads_of_algebra() == {1}
        second.__exit__(None, None, None)
        assert threads_of_algebra() == {2}
