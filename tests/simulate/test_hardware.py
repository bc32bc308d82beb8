"""Instruments and motors between a controller and an arm."""

import copy
import pickle

import numpy as np
import pytest
import scipy.sparse
from scipy import signal
from scipy.integrate import solve_ivp

import flexarm as fa
from arms import two_rods
from controllers import Script

TICK = 0.002


@pytest.fixture(scope="module")
def arm():
    return two_rods(gauged=1)


def moved(arm, *instruments, motors=None, seed=0, duration=0.2, torques=None, **options):
    torques = [[1.0, 0.3], [-0.5, 0.4], [0.8, -0.2]] if torques is None else torques
    hardware = fa.Hardware(instruments or None, motors, seed)
    script = Script(np.repeat(torques, 10, axis=0), TICK)
    return fa.simulate(
        arm, duration, controller=script, hardware=hardware, rate=1.0 / TICK, **options
    )


def test_resolution_rounds_to_the_nearest_multiple(arm):
    step = 2 * np.pi / 4096
    result = moved(arm, fa.Instrument("joint_angle", resolution=step))
    measured, true = result.measured_joint_angle.values, result.joint_angle.values[:-1]
    assert measured.shape == (100, 2)
    np.testing.assert_allclose(measured, step * np.round(measured / step), rtol=0, atol=1e-14)
    error = abs(measured - true)
    assert error.max() <= step / 2 * (1 + 1e-9)
    assert error.max() > step / 4  # rounding has an effect


def test_noise_has_its_deviation_its_seed_and_is_white(arm):
    instruments = fa.Instrument("strain", noise=1e-5, bias=3e-5), fa.Instrument("tip", noise=1e-3)
    result = moved(arm, *instruments, duration=4.0)
    error = result.measured_strain.values[:, 0] - result.strain.values[:-1, 0]
    # 2000 draws: the mean is accurate to 1/sqrt(2000) = 2 %, the deviation to 1.6 %; four sigmas.
    assert error.mean() == pytest.approx(3e-5, abs=0.09e-5)
    assert error.std() == pytest.approx(1e-5, rel=0.065)
    white = np.corrcoef(error[1:], error[:-1])[0, 1]
    assert abs(white) < 0.09
    again, other = (moved(arm, *instruments, seed=seed) for seed in (0, 1))
    np.testing.assert_array_equal(again.measured_strain, result.measured_strain[:100])
    assert not np.any(other.measured_strain.values == again.measured_strain.values)
    np.testing.assert_array_equal(again.q.values, other.q.values)  # the controller does not use it


def test_camera_returns_the_delayed_position_of_the_tip(arm):
    camera = fa.Instrument("tip", name="camera", sample_time=5 * TICK, delay=0.013)
    result = moved(arm, camera)
    measured = result.measured_camera.values
    tip = result.tip.values
    for k in range(len(measured)):
        # 13 ms are 6.5 sample times: readings are available from the seventh on.
        frame = max((k - 7) // 5 * 5, 0)
        np.testing.assert_allclose(measured[k], tip[frame], rtol=0, atol=1e-14)


def test_rate_from_an_encoder_follows_the_documented_filter(arm):
    cutoff = 40.0
    result = moved(arm, fa.Instrument("joint_angle", resolution=1e-4, rate_cutoff=cutoff))
    read = result.measured_joint_angle.values
    lag = 1.0 / (2 * np.pi * cutoff)
    b, a = signal.bilinear([1.0, 0.0], [lag, 1.0], fs=1.0 / TICK)
    wanted = signal.lfilter(b, a, read - read[0], axis=0)
    # Rounding of sums of a hundred terms divided by the sample time.
    np.testing.assert_allclose(result.measured_joint_rate, wanted, rtol=0, atol=1e-11)


def test_accelerometer_reads_gravity_at_rest_and_centripetal_acceleration():
    link = fa.Link(length=0.5, mass_per_length=0.6, flexible=False)
    arm = fa.Arm(links=[link], gravity=(0.0, -9.81))
    sensor = fa.Sensor("acceleration", link=1, frame="link", name="accelerometer")
    holding = 0.6 * 0.5 * 9.81 * 0.25 * np.cos(0.4)
    options = {"hardware": fa.Hardware([fa.Instrument(sensor)]), "initial": [0.4]}
    reading = fa.simulate(arm, 0.1, controller=Script([[holding]], TICK), **options)
    wanted = [9.81 * np.sin(0.4), 9.81 * np.cos(0.4)]
    # The first reading precedes all torques; the free link falls.
    np.testing.assert_allclose(reading.measured_accelerometer[1:], [wanted] * 49, rtol=0, atol=1e-9)
    turning = fa.simulate(
        fa.Arm(links=[link]), 0.1, controller=Script([[0.0]], TICK), initial_rate=[3.0], **options
    )
    pull = turning.measured_accelerometer.values
    np.testing.assert_allclose(pull, [[-9.0 * 0.5, 0.0]] * 50, rtol=0, atol=1e-9)


@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")
def test_readings_are_limited(arm):
    result = moved(arm, fa.Instrument("joint_rate", limit=0.3))
    true = result.joint_rate.values[:-1]
    cut = np.clip(true, -0.3, 0.3)
    np.testing.assert_allclose(result.measured_joint_rate, cut, rtol=0, atol=1e-12)
    assert abs(true).max() > 0.5


def test_without_instruments_the_sensors_are_exact(arm):
    plain = fa.simulate(arm, 0.2, controller=Script([[0.4, 0.1]], TICK), rate=1.0 / TICK)
    exact = fa.simulate(
        arm, 0.2, controller=Script([[0.4, 0.1]], TICK), rate=1.0 / TICK, hardware=fa.Hardware()
    )
    np.testing.assert_array_equal(plain.q, exact.q)
    # The loop and samples have the same times except for rounding.
    np.testing.assert_allclose(exact.measured_strain, exact.strain[:-1], rtol=0, atol=1e-17)
    assert not any(name.startswith("measured") for name in plain.data_vars)


def constant_torque_run(arm, rate, rows, duration):
    return fa.simulate(
        arm, duration, torque=rows, rate=rate, torque_interpolation="hold", rtol=1e-10, atol=1e-12
    )


TIGHT = {"rtol": 1e-10, "atol": 1e-12}


def test_torque_limit_clips_the_torque(arm):
    limited = moved(arm, motors=fa.Motors(torque_limit=[0.6, 0.25]), **TIGHT)
    requested = limited.torque_command.values
    np.testing.assert_array_equal(limited.torque, np.clip(requested, [-0.6, -0.25], [0.6, 0.25]))
    assert abs(requested).max() == 1.0
    open_loop = constant_torque_run(arm, 1.0 / TICK, limited.torque.values, 0.2)
    np.testing.assert_allclose(limited.q, open_loop.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize("delay", [0.0005, 0.002, 0.005])
def test_delay_shifts_the_torque(arm, delay):
    """Against a run with the shifted torque, constant over quarters of a sample time."""
    late = moved(arm, motors=fa.Motors(delay=delay), **TIGHT)
    rows = np.repeat(
        np.resize(np.repeat([[1.0, 0.3], [-0.5, 0.4], [0.8, -0.2]], 10, 0), (101, 2)), 4, 0
    )
    shift = round(delay / TICK * 4)
    rows = np.concatenate([np.zeros((shift, 2)), rows])[: 4 * 100 + 1]
    shifted = constant_torque_run(arm, 4.0 / TICK, rows, 0.2)
    np.testing.assert_allclose(late.q, shifted.q[::4], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(late.torque[:-1], rows[:-1:4])


@pytest.mark.parametrize("lag", [0.0002, 0.0015, 0.02])
def test_lag_is_a_first_order_filter(lag):
    """A rigid link against SciPy: rate and torque integrated together."""
    inertia = 0.6 * 0.5**3 / 3
    arm = fa.Arm(links=[fa.Link(length=0.5, mass_per_length=0.6, flexible=False)])
    requested = np.array([[0.3], [-0.2], [0.1], [0.1]])
    run = fa.simulate(
        arm,
        8 * TICK,
        controller=Script(requested, TICK),
        hardware=fa.Hardware(motors=fa.Motors(time_constant=lag, torque_limit=0.25)),
        rate=2.0 / TICK,
        **TIGHT,
    )
    state, wanted = np.zeros(3), []
    for tick in range(8):
        target = np.clip(requested[tick % 4, 0], -0.25, 0.25)

        def slope(t, y, target=target):
            return [y[1], y[2] / inertia, (target - y[2]) / lag]

        span, middle = (0.0, TICK), [0.0, TICK / 2, TICK]
        found = solve_ivp(slope, span, state, "DOP853", middle, rtol=1e-11, atol=1e-14)
        wanted += found.y[:, :2].T.tolist()
        state = found.y[:, -1]
    wanted = np.array(wanted)
    np.testing.assert_allclose(run.torque[:-1, 0], wanted[:, 2], rtol=0, atol=1e-9)
    # Cubics follow the exponential within 1e-5 of the change of torque, up to 0.5 N m.
    np.testing.assert_allclose(run.joint_rate[:-1, 0], wanted[:, 1], rtol=0, atol=2e-6)


def test_current_and_voltage_limit_the_torque():
    motors = fa.Motors(torque_constant=2.0, current_limit=3.0, voltage_limit=24.0, resistance=4.0)
    requested = np.array([100.0])
    # At rest the current limit applies, 2 * 3; turning at 8 rad/s: 2 (24 - 16) / 4.
    np.testing.assert_allclose(motors.allowed(requested, np.array([0.0])), [6.0])
    np.testing.assert_allclose(motors.allowed(requested, np.array([8.0])), [4.0])
    np.testing.assert_allclose(motors.allowed(-requested, np.array([8.0])), [-6.0])
    # Faster than the idle speed, 24 / 2, the motor can only brake.
    np.testing.assert_allclose(motors.allowed(requested, np.array([13.0])), [-1.0])
    # At this speed the voltage alone gives 2 (24 - 40) / 4 = -8: the current limit applies last.
    np.testing.assert_allclose(motors.allowed(requested, np.array([20.0])), [-6.0])
    for wrong in (scipy.sparse.csr_array([[1.0]]), "x", np.ma.masked_array([1.0], [True])):
        with pytest.raises(fa.InputError, match=r"Motors\.allowed: torque must be numbers"):
            motors.allowed(wrong, requested)
    arm = fa.Arm(links=[fa.Link(length=0.5, mass_per_length=0.6, flexible=False)])
    spun = fa.simulate(
        arm,
        2.0,
        controller=Script([requested], TICK),
        hardware=fa.Hardware(motors=motors),
        rate=100.0,
    )
    assert float(spun.joint_rate[-1, 0]) == pytest.approx(12.0, rel=1e-3)  # idle speed


def test_work_of_the_applied_torque_is_the_energy(arm):
    motors = fa.Motors(delay=0.0013, time_constant=0.003, torque_limit=0.7)
    result = moved(arm, motors=motors, **TIGHT, duration=0.3)
    script = Script(np.repeat([[1.0, 0.3], [-0.5, 0.4], [0.8, -0.2]], 10, axis=0), TICK)
    hardware = fa.Hardware(motors=motors)
    fine = fa.simulate(arm, 0.3, controller=script, hardware=hardware, rate=40000.0, **TIGHT)
    power = (fine.torque * fine.joint_rate).sum("joint").values
    work = np.trapezoid(power, fine.time.values)
    energy = float((fine.kinetic_energy + fine.strain_energy)[-1])
    # Kinks of the torque between samples of the trapezoidal rule: 25 us of 0.7 N m, 0.1 rad/s each.
    assert energy == pytest.approx(work, rel=1e-4)
    np.testing.assert_allclose(result.q[-1], fine.q[-1], rtol=0, atol=1e-9)


def test_unknown_reading_ends_the_run_and_lists_the_available_ones(arm):
    class Asks(Script):
        def update(self, t, measurement, reference):
            return measurement.tip

    with pytest.raises(
        fa.SimulationError, match="'tip'; available readings: joint_angle, joint_rate"
    ):
        fa.simulate(arm, 0.1, controller=Asks([[0.0, 0.0]], TICK))


def test_a_measurement_is_a_mapping():
    measurement = fa.Measurement(joint_angle=np.ones(2), tip=np.zeros(2))
    assert list(measurement) == ["joint_angle", "tip"]
    assert measurement["tip"] is measurement.tip
    assert "strain" not in measurement
    assert "joint_angle=[1. 1.]" in repr(measurement)


@pytest.mark.parametrize(
    ("hardware", "words"),
    [
        (fa.Hardware([fa.Instrument("tip", sample_time=0.003)]), "multiple of the controller's"),
        (fa.Hardware([fa.Instrument(fa.Sensor("velocity", link=3))]), "number of a link, 1 to 2"),
        (fa.Hardware(motors=fa.Motors(torque_limit=[1.0, 2.0, 3.0])), "must have length 2, one"),
        (fa.Hardware([fa.Instrument("contact_force")]), "contact_force"),
        ("an encoder", "hardware must be a Hardware"),
    ],
)
def test_hardware_that_does_not_match_the_arm_is_rejected_before_the_run(arm, hardware, words):
    with pytest.raises(fa.InputError, match=words):
        fa.simulate(arm, 0.1, controller=Script([[0.0, 0.0]], TICK), hardware=hardware)


def test_measurement_can_be_copied_and_stored():
    measurement = fa.Measurement(joint_angle=np.ones(2))
    for again in (copy.copy(measurement), copy.deepcopy(measurement)):
        np.testing.assert_array_equal(again.joint_angle, measurement.joint_angle)
    kept = pickle.loads(pickle.dumps(measurement))
    assert list(kept) == ["joint_angle"]
