"""Each position controller against its control law written out for single numbers."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.hardware.measurement import Measurement

TICK = 0.002


def arm(**options):
    rod = {"flexural_rigidity": [30.0, 20.0], "mass_per_length": 0.5, "elements": 2}
    return chain((0.8, 0.6), [0.05, {"hub_inertia": 0.03, "mass": 0.2}], **rod, **options)


def readings(count=40, gauges=0, seed=3):
    """Return random measurements, which need not be consistent."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield Measurement(
            joint_angle=rng.normal(size=2),
            joint_rate=rng.normal(size=2),
            strain=1e-3 * rng.normal(size=gauges),
        )


class Steady:
    """A reference that is constant and moves at the same time, because its numbers need not be
    consistent."""

    def joint_angle(self, t):
        return np.array([0.3, -0.2])

    def joint_rate(self, t):
        return np.array([1.0, 2.0])

    def joint_acceleration(self, t):
        return np.array([-4.0, 3.0])


def answers(controller, **options):
    controller.reset()
    return [
        (stated, np.array(controller.update(k * controller.sample_time, stated, Steady())))
        for k, stated in enumerate(readings(**options))
    ]


def test_pid_with_a_limit():
    """The integral adds an error unless the limit is reached and the error has the same sign."""
    P, integral, D, limit = (8.0, 5.0), (30.0, 20.0), (0.5, 0.2), (10.0, 7.0)
    controller = fa.JointPID(P, D, integral, torque_limit=limit, sample_time=TICK)
    held = [0.0, 0.0]
    saturated = 0
    for stated, found in answers(controller):
        for j in range(2):
            error = [0.3, -0.2][j] - stated.joint_angle[j]
            rate_error = [1.0, 2.0][j] - stated.joint_rate[j]
            torque = P[j] * error + held[j] + D[j] * rate_error
            given = max(-limit[j], min(limit[j], torque))
            if given == torque or error * torque < 0:
                held[j] += integral[j] * TICK * error
            saturated += given != torque
            assert found[j] == pytest.approx(given, rel=1e-13)
    assert 10 < saturated < 70  # both cases occur


@pytest.mark.thorough
@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")  # intended
def test_integral_does_not_wind_up():
    """The motor is too weak at first: if the limit is known, there is no overshoot."""
    plant = arm(gravity=(0.0, 0.0)).rigid()
    motion = fa.joint_motion(plant, [0.0, 0.0], [1.2, 0.0], 0.2)
    hardware = fa.Hardware(motors=fa.Motors(torque_limit=1.0))
    over = []
    for limit in (np.inf, 1.0):
        controller = fa.JointPID([40.0, 20.0], [9.0, 3.0], [60.0, 30.0], torque_limit=limit)
        run = fa.simulate(
            plant, 4.0, controller=controller, reference=motion, hardware=hardware, rate=100.0
        )
        over.append(float(run.joint_angle.sel(joint=1).max()) - 1.2)
    assert over[1] < 0.5 * over[0]


@pytest.mark.thorough
def test_integral_removes_the_error_of_an_unknown_payload():
    weight = (0.0, -9.81)
    believed = arm(gravity=weight).rigid()
    plant = arm(gravity=weight, payload=fa.Payload(mass=0.2)).rigid()
    motion = fa.joint_motion(believed, [0.3, 0.4], [0.5, 0.2], 0.5)
    errors = []
    for integral in (0.0, [40.0, 15.0]):
        controller = fa.JointPID([30.0, 12.0], [3.0, 1.0], integral, arm=believed)
        run = fa.simulate(
            believed, 20.0, controller=controller, reference=motion, plant=plant, rate=20.0
        )
        errors.append(abs(run.joint_angle.values[-1] - [0.5, 0.2]).max())
    assert errors[0] > 0.02
    assert errors[1] < 1e-3 * errors[0]


@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_gravity_torque_of_an_arm_that_sags(theory):
    """The torque equals that of `equilibrium`, which uses another method."""
    flexible = arm(gravity=(0.0, -9.81), theory=theory, payload=fa.Payload(mass=0.1))
    controller = fa.JointPID(0.0, 0.0, arm=flexible, sag=True)
    straight = fa.JointPID(0.0, 0.0, arm=flexible)
    for angles in ([0.2, -0.4], [1.0, 0.9]):
        controller.reset()
        stated = Measurement(joint_angle=np.array(angles), joint_rate=np.zeros(2))
        wanted = fa.equilibrium(flexible, angles).torque
        found = controller.update(0.0, stated, None)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)
        rigid = flexible.rigid().bias_force(np.array(angles), np.zeros(2))
        np.testing.assert_allclose(straight.update(0.0, stated, None), rigid, rtol=1e-12)
        assert abs(rigid - wanted).max() > 1e-3  # the sag matters
    # Another posture at the next sample times: each call corrects the sag.
    stated = Measurement(joint_angle=np.array([0.9, 0.9]), joint_rate=np.zeros(2))
    for k in range(12):
        found = controller.update(k * 1e-3, stated, None)
    wanted = fa.equilibrium(flexible, [0.9, 0.9]).torque
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-9)


def test_sagging_arm_is_held_at_its_posture():
    flexible = arm(gravity=(0.0, -9.81))
    hung = fa.equilibrium(flexible, [0.4, 0.3])
    controller = fa.JointPID([5.0, 3.0], [0.5, 0.2], arm=flexible, sag=True)
    run = fa.simulate(flexible, 1.0, controller=controller, initial=hung.q, rate=50.0)
    np.testing.assert_allclose(run.joint_angle.values, [[0.4, 0.3]] * 51, rtol=0, atol=1e-7)


def test_computed_torque_gives_the_wanted_accelerations():
    """By forward dynamics of the rigid arm."""
    rigid = arm(gravity=(0.0, -9.81)).rigid()
    controller = fa.ComputedTorque(rigid, [2.0, 3.0], [0.7, 1.0])
    w = 2.0 * np.pi * np.array([2.0, 3.0])
    for stated, torque in answers(controller):
        angle, rate = np.array([0.3, -0.2]), np.array([1.0, 2.0])
        wanted = np.array([-4.0, 3.0]) + 2.0 * np.array([0.7, 1.0]) * w * (rate - stated.joint_rate)
        wanted = wanted + w**2 * (angle - stated.joint_angle)
        found = rigid.forward_dynamics(stated.joint_angle, stated.joint_rate, torque)
        np.testing.assert_allclose(found, wanted, rtol=1e-10)


def test_computed_torque_with_feedforward():
    """The given torque, at the middle of the sample time, and M times the correction."""
    model = arm()
    controller = fa.ComputedTorque(
        model, 2.0, 0.7, feedforward=lambda t: [t, 2.0 * t], sample_time=TICK
    )
    w = 4.0 * np.pi
    for k, (stated, torque) in enumerate(answers(controller)):
        error = np.array([0.3, -0.2]) - stated.joint_angle
        rate_error = np.array([1.0, 2.0]) - stated.joint_rate
        M = model.rigid().mass_matrix(stated.joint_angle)
        middle = (k + 0.5) * TICK
        wanted = [middle, 2.0 * middle] + M @ (w**2 * error + 1.4 * w * rate_error)
        np.testing.assert_allclose(torque, wanted, rtol=1e-12)


def test_strain_feedback():
    """Rates by Tustin's rule, a difference equation written out."""
    K, R, cutoff = np.array([[300.0, 20.0, 5.0], [0.0, 70.0, 9.0]]), np.ones((2, 3)), 50.0
    controller = fa.StrainFeedback(
        [8.0, 5.0], [0.5, 0.2], K, 3.0 * R, rate_cutoff=cutoff, sample_time=TICK
    )
    before, rate = None, np.zeros(3)
    T = 1.0 / (2.0 * np.pi * cutoff)
    for stated, torque in answers(controller, gauges=3):
        if before is not None:
            rate = ((2 * T - TICK) * rate + 2 * (stated.strain - before)) / (2 * T + TICK)
        before = stated.strain
        wanted = np.array([8.0, 5.0]) * ([0.3, -0.2] - stated.joint_angle)
        wanted = wanted + np.array([0.5, 0.2]) * ([1.0, 2.0] - stated.joint_rate)
        wanted = wanted - K @ stated.strain - 3.0 * R @ rate
        np.testing.assert_allclose(torque, wanted, rtol=1e-12)


def test_strain_gains_for_one_gauge_per_joint():
    stated = Measurement(
        joint_angle=np.zeros(2), joint_rate=np.zeros(2), strain=np.array([1e-3, -2e-3])
    )
    for gains, wanted in (([100.0, 50.0], [-0.1, 0.1]), (100.0, [-0.1, 0.2])):
        controller = fa.StrainFeedback(0.0, 0.0, gains)
        np.testing.assert_allclose(controller.update(0.0, stated, None), wanted, rtol=1e-14)


def test_feedforward_is_evaluated_for_many_samples_in_one_call():
    """A function of many times is called only once for many samples, and gives the same values."""

    class Torque:
        vectorized = True
        calls = 0

        def __call__(self, t):
            Torque.calls += 1
            return np.stack([np.sin(t), np.cos(t)], axis=-1)

    stated = Measurement(joint_angle=np.zeros(2), joint_rate=np.zeros(2))
    controller = fa.JointPD(0.0, 0.0, sample_time=TICK, feedforward=Torque())
    for k in [*range(1030), 5]:
        middle = (k + 0.5) * TICK
        found = controller.update(k * TICK, stated, None)
        np.testing.assert_allclose(found, [np.sin(middle), np.cos(middle)], rtol=1e-12)
    assert Torque.calls <= 5  # the first sample alone, blocks of 512, and the sample of before


def test_sag_is_corrected_once_per_sample(monkeypatch):
    """The first call converges; later ones cost one inverse dynamics, as sampled loops require."""
    controller = fa.JointPID(0.0, 0.0, arm=arm(gravity=(0.0, -9.81)), sag=True)
    stated = Measurement(joint_angle=np.array([0.2, -0.4]), joint_rate=np.zeros(2))
    calls = []
    inverse = KernelView.inverse_dynamics
    monkeypatch.setattr(
        KernelView, "inverse_dynamics", lambda *a: (calls.append(1), inverse(*a))[1]
    )
    controller.update(0.0, stated, None)
    assert len(calls) > 1
    calls.clear()
    controller.update(1e-3, stated, None)
    assert len(calls) == 1
