"""The Kalman filters against linear theory, its own statistics, and payloads."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

import flexarm as fa
from arms import chain, observed_link
from flexarm.control.filters.predicted_readings import PredictedReadings
from flexarm.control.hardware.measurement import Measurement
from flexarm.linear.step_derivatives.sampled_step import FreeParameters, SampledStep


def two_links(payload=0.2, offset=(0.0, 0.0)):
    rod = {"flexural_rigidity": 200.0, "mass_per_length": 0.5, "elements": 2, "modes": 2}
    joints = [0.1, fa.Joint(mass=0.4, hub_inertia=0.03, housing_inertia=0.03)]
    more = {"payload": fa.Payload(mass=payload, offset=offset), "gravity": (0.0, -9.81)}
    return chain((0.8, 0.6), joints, gauge=(0.03, 0.005), **rod, **more)


ENCODER = fa.Instrument("joint_angle", noise=2e-4)
STRAIN = fa.Instrument("strain", noise=3e-6)
ACCELEROMETER = fa.Instrument(
    fa.Sensor("acceleration", link=1, frame="link", name="accelerometer"), noise=0.05
)


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.05, 0.02)])
def test_single_step_is_exact(offset):
    arm = two_links(offset=offset)
    random = np.random.default_rng(2)
    x, torque = 0.1 * random.standard_normal(2 * arm.dof), np.array([0.4, -0.2])
    step = SampledStep(arm, 2e-5)
    assert step.steps == 1
    found = step.take(x, torque)
    wanted = fa.step_jacobian(
        arm, x[: arm.dof], x[arm.dof :], torque, 2e-5, parameters=["payload.mass"]
    )
    np.testing.assert_allclose(found.after, np.concatenate([wanted.q, wanted.qd]), rtol=1e-12)
    for one, other in (
        (found.state, wanted.state),
        (found.torque, wanted.torque),
        (found.parameters[:, 0], wanted.parameters["payload.mass"]),
    ):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12 * abs(other).max())
    # A changed parameter is a changed arm.
    heavier = fa.varied(arm, payload_mass=0.5)
    other = SampledStep(heavier, 2e-5).take(x, torque)
    np.testing.assert_allclose(step.take(x, torque, np.array([0.3])).after, other.after, rtol=1e-12)


def test_number_of_steps_follows_from_the_fastest_mode():
    arm = two_links()
    run = fa.simulate(
        arm, 0.01, torque=lambda t: [2.0, -1.0], initial=arm.rest([0.3, -0.4]), rtol=1e-11
    )
    step = SampledStep(arm, 0.01)
    x = step.take(np.concatenate([arm.rest([0.3, -0.4]), np.zeros(arm.dof)]), np.array([2.0, -1.0]))
    assert step.steps > 5
    # Ten milliseconds under 2 N m: fast modes to half a part in a hundred.
    scale = abs(run.q.values[-1]).max()
    np.testing.assert_allclose(x.after[: arm.dof], run.q.values[-1], rtol=0, atol=1e-4 * scale)


# The random state bends the links far, which does not affect the comparison.
@pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")
def test_predicted_readings_equal_those_of_the_linear_model():
    arm = two_links()
    random = np.random.default_rng(4)
    x, torque = 0.1 * random.standard_normal(2 * arm.dof), np.array([0.4, -0.2])
    velocity = fa.Sensor("velocity", link=2, station=0.3)
    readings = PredictedReadings(
        arm, [STRAIN, ACCELEROMETER, ENCODER, fa.Instrument(velocity, noise=1.0)]
    )
    free = FreeParameters(arm, ["payload.mass"])
    constants = free.at()
    values, slopes, by_mass, by_torque = readings.predict(x, torque, constants)
    model = fa.linearize(
        arm,
        x[: arm.dof],
        x[arm.dof :],
        torque,
        outputs=["strain", ACCELEROMETER.output, "joint_angle", velocity],
    )
    np.testing.assert_allclose(values, model.output, rtol=1e-11, atol=1e-13)
    np.testing.assert_allclose(slopes, model.C, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(by_torque, model.D, rtol=1e-9, atol=1e-9)
    step = 1e-6
    ahead = readings.predict(x, torque, free.at(np.array([step]))).values
    np.testing.assert_allclose((ahead - values) / step, by_mass[:, 0], rtol=1e-4, atol=1e-6)


def record(arm, plant, duration, seed, noise=0.0, instruments=(ENCODER, STRAIN), initial=None):
    """Return torques and readings of a plant under PD control and random torques."""
    random = np.random.default_rng(seed)
    joints = arm.n_joints

    class Shaken(fa.Controller):
        sample_time = 1e-3

        def reset(self):
            self.asked = []

        def update(self, t, measurement, reference):
            wanted = 0.3 * np.sin(np.array([4.0, 7.0])[:joints] * t)
            torque = 20.0 * (wanted - measurement.joint_angle) + 3.0 * np.cos(9.0 * t)
            self.asked.append(torque)
            return torque + noise * random.standard_normal(joints)

    controller = Shaken()
    options = {} if initial is None else {"initial": initial[0], "initial_rate": initial[1]}
    run = fa.simulate(
        arm,
        duration,
        controller=controller,
        plant=plant,
        hardware=fa.Hardware(instruments, seed=seed),
        **options,
    )
    names = [item.label for item in instruments]
    return run, np.array(controller.asked), {n: run[f"measured_{n}"].values for n in names}


BOTH = pytest.mark.parametrize("kind", [fa.ExtendedKalmanFilter, fa.UnscentedKalmanFilter])


@pytest.mark.thorough_cases("UnscentedKalmanFilter")
@BOTH
def test_filter_of_a_linear_arm_equals_the_kalman_filter(kind):
    """A single link with one mode hardly turns, so it is almost linear."""
    arm = observed_link()
    filters = kind(arm, [ENCODER, STRAIN], torque_noise=0.2)
    _, torque, readings = record(arm, arm, 0.3, seed=5, noise=0.2)
    scale = 1e-4  # a factor on all values: quadratic terms are smaller by another such factor
    readings = {name: scale * values for name, values in readings.items()}
    found = filters.run(scale * torque, readings)

    model = fa.linearize(arm, outputs=["joint_angle", "strain"])
    n = 2 * arm.dof
    block = np.block([[model.A, model.B], [np.zeros((1, n + 1))]])
    whole = expm(1e-3 * block)
    F, G = whole[:n, :n], whole[:n, n:]
    R = np.diag([ENCODER.noise**2, STRAIN.noise**2])
    filters.reset()
    filters._begin(Measurement(joint_angle=readings["joint_angle"][0]))
    P, x = filters.covariance[:n, :n], np.concatenate([filters.q, filters.qd])
    for k in range(len(torque)):
        if k:
            x, P = F @ x + G @ (scale * torque[k - 1]), F @ P @ F.T + 0.04 * G @ G.T
        y = np.concatenate([readings["joint_angle"][k], readings["strain"][k]])
        K = P @ model.C.T @ np.linalg.inv(model.C @ P @ model.C.T + R)
        x, P = x + K @ (y - model.C @ x), (np.eye(n) - K @ model.C) @ P
        # Four-stage steps of less than 0.1 rad of the mode: 1e-7 of the change.
        got = np.concatenate([found.q[k], found.qd[k]])
        np.testing.assert_allclose(got, x, rtol=1e-5, atol=1e-6 * abs(x).max())
        np.testing.assert_allclose(found.covariance[k][:n, :n], P, rtol=1e-4, atol=1e-6 * P.max())


@pytest.mark.thorough
@BOTH
def test_errors_have_the_covariance_of_the_filter(kind):
    """Normalised errors squared of 25 runs against the chi-squared distribution."""
    arm, runs = observed_link(), 25
    random = np.random.default_rng(11)
    filters = kind(arm, [ENCODER, STRAIN, ACCELEROMETER], torque_noise=0.3, payload_deviation=0.05)
    deviations = np.array([1e-3, 2e-3, 0.1, 0.05])  # joint, mode, and their rates
    start = np.concatenate([deviations, [0.05]])
    total = 0.0
    for run_number in range(runs):
        drawn = start * random.standard_normal(5)
        plant = fa.varied(arm, payload_mass=0.2 + drawn[4])
        run, torque, readings = record(
            arm,
            plant,
            0.15,
            seed=run_number,
            noise=0.3,
            instruments=(ENCODER, STRAIN, ACCELEROMETER),
            initial=(drawn[:2], drawn[2:4]),
        )
        filters.reset()
        filters.begin(np.zeros(2), np.zeros(2), 0.2, np.diag(start**2))
        for k in range(len(torque)):
            if k:
                filters.predict(torque[k - 1])
            filters.correct(Measurement(**{n: v[k] for n, v in readings.items()}))
        at = round(1000 * 0.001 * (len(torque) - 1))
        truth = np.concatenate([run.q.values[at], run.qd.values[at], [0.2 + drawn[4]]])
        error = np.concatenate([filters.q, filters.qd, [filters.payload_mass]]) - truth
        total += error @ np.linalg.solve(filters.covariance, error)
    # Seeds are fixed; with others the test would fail once in a hundred times.
    assert chi2.ppf(0.005, 5 * runs) < total < chi2.ppf(0.995, 5 * runs)


@pytest.mark.thorough
@pytest.mark.parametrize("factor", [0.0, 1.0, 2.0, 3.0])
def test_payload_is_estimated(factor):
    arm = two_links()
    plant = fa.varied(arm, payload_factor=factor)
    run, torque, readings = record(arm, plant, 0.8, seed=1)
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], 0.02, payload_deviation=0.3)
    found = filters.run(torque, readings)
    # Links so stiff that the linear theory holds: they bend by less than a twentieth.
    assert abs(run.link_tip_deflection.values).max() < 0.05 * 0.8
    missed = found.payload_mass[-1] - 0.2 * factor
    # then its error is consistent: four of its deviations are exceeded once in 16000 times
    if factor == 1.0:
        assert abs(missed) < 4.0 * np.sqrt(found.covariance[-1][-1, -1])
    # The first readings are weighted with the slopes of the initial mass, which later readings do
    # not correct: a hundredth of the believed mass.
    assert abs(missed) < 2e-3
    truth = run.q.values[np.arange(0, 800)]
    late = slice(400, None)
    assert abs(found.q - truth)[late].max() < 1e-3
    assert np.all(found.payload_mass >= 0.0)


@pytest.mark.thorough
@pytest.mark.parametrize("start", [0.0, 0.1])
def test_wide_prior_of_the_mass_is_not_narrowed_by_wrong_estimates_of_vibration(start):
    """With these seeds one Gaussian over the mass ended at 0.2 to 0.4 kg, with a deviation of 0.1
    g."""
    rod = {"elements": 1, "gauges": [fa.Gauge(station=0.02, distance=0.005)]}
    rod["damping"] = fa.ModalDamping(ratio=0.005)
    arm = fa.Arm(
        links=[
            fa.Link(length=0.9, flexural_rigidity=500.0, mass_per_length=0.7, **rod),
            fa.Link(length=0.7, flexural_rigidity=350.0, mass_per_length=0.5, **rod),
        ],
        joints=[
            fa.Joint(hub_inertia=0.2),
            fa.Joint(mass=0.6, hub_inertia=0.05, housing_inertia=0.05),
        ],
        payload=fa.Payload(mass=0.5),
    )
    instruments = [
        fa.Instrument("joint_angle", noise=1e-4),
        fa.Instrument("strain", noise=2e-6),
    ]
    line = fa.line_motion(arm, [1.2, 0.3], [0.3, 1.2], 1.0, start_time=start)
    filters = fa.ExtendedKalmanFilter(arm, instruments, 0.02, payload_deviation=0.5)
    total = 0.0
    for seed in (0, 2, 4):
        run = fa.simulate(
            arm,
            0.4,
            controller=fa.JointPD([300.0, 80.0], [25.0, 6.0]),
            reference=line,
            plant=fa.varied(arm, payload_mass=1.0),
            hardware=fa.Hardware([*instruments, fa.Instrument("joint_rate")], seed=seed),
        )
        readings = {item.label: run[f"measured_{item.label}"].values for item in instruments}
        found = filters.run(run.torque_command.values[: len(readings["strain"])], readings)
        deviation = np.sqrt(found.covariance[:, -1, -1])
        # Before the motion the distribution is wide and skew; deviations have little meaning there.
        assert np.all(np.abs(found.payload_mass - 1.0)[-100:] < 4.0 * deviation[-100:])
        assert deviation[-1] < 0.02
        assert found.consistent
        total += ((found.payload_mass[-1] - 1.0) / deviation[-1]) ** 2
    # Seeds are fixed; with others the test would fail once in a thousand times.
    assert total < chi2.ppf(0.999, 3)


def test_first_reading_is_used_once():
    arm = observed_link()
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER])
    filters.correct(Measurement(joint_angle=np.array([0.3])))
    assert filters.q[0] == pytest.approx(0.3, abs=1e-12)
    # The initial deviation is 100 times the noise.
    assert filters.covariance[0, 0] == pytest.approx(ENCODER.noise**2, rel=2e-4)


@pytest.mark.parametrize(("mass", "deviation"), [(0.2, 0.1), (0.2, 0.05), (0.2, 0.02)])
def test_sum_of_gaussians_has_the_given_mean_and_covariance(mass, deviation):
    arm = two_links(payload=mass)
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=deviation)
    filters._begin(Measurement(joint_angle=np.array([0.3, -0.4])))
    # Discrete weights and a finite range: a hundredth of the deviation.
    assert filters.payload_mass == pytest.approx(mass, abs=0.02 * deviation)
    assert np.sqrt(filters.covariance[-1, -1]) == pytest.approx(deviation, rel=0.05)
    # Links sag in proportion to the mass: fully correlated except for vibration.
    assert np.min(np.linalg.eigvalsh(filters.covariance)) >= 0.0


def test_estimated_payload_is_not_negative():
    arm = two_links(payload=0.0)
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER], payload_deviation=0.3, payload_drift=0.01)
    filters._begin(Measurement(joint_angle=np.array([0.3, -0.4])))
    assert 0.0 < filters.payload_mass < 0.4
    filters.predict(np.zeros(2))
    assert np.all(np.isfinite(filters.covariance))


@pytest.mark.thorough
def test_inconsistent_filter_is_reported():
    arm = two_links()
    plant = fa.varied(arm, flexural_rigidity_factor=0.5)
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], 0.02)
    controller = fa.EstimatorController(filters, fa.JointPD([20.0, 8.0], [2.0, 0.8]))
    motion = fa.joint_motion(arm, [0.2, -0.4], [0.5, 0.1], 0.3)
    options = {"reference": motion, "hardware": fa.Hardware([ENCODER, STRAIN], seed=2)}
    with pytest.warns(fa.InconsistentEstimateWarning, match="times as large") as caught:
        run = fa.simulate(arm, 0.3, controller=controller, plant=plant, **options)
    assert len(caught) == 1
    assert caught[0].filename == __file__
    assert run.estimator_consistent == 0
    assert run.estimator_innovation > 2.0
    right = fa.simulate(arm, 0.3, controller=controller, **options)
    assert right.estimator_consistent == 1
    assert 0.5 < right.estimator_innovation < 1.5


@pytest.mark.thorough
def test_inner_controller_receives_the_estimates():
    arm = two_links()
    plant = fa.varied(arm, payload_factor=2.0)

    class Looks(fa.JointPD):
        def update(self, t, measurement, reference):
            self.seen = measurement
            return super().update(t, measurement, reference)

    inner = Looks([20.0, 8.0], [2.0, 0.8])
    filters = fa.ExtendedKalmanFilter(arm, [ENCODER, STRAIN], 0.05, payload_deviation=0.3)
    controller = fa.EstimatorController(filters, inner)
    motion = fa.joint_motion(arm, [0.2, -0.4], [0.5, 0.1], 0.6)
    hardware = fa.Hardware([ENCODER, STRAIN], seed=2)
    run = fa.simulate(
        arm, 0.8, controller=controller, reference=motion, plant=plant, hardware=hardware
    )
    last = run.q.values[-2]  # of the last sample
    np.testing.assert_allclose(inner.seen.q, last, rtol=0, atol=3e-3)
    np.testing.assert_allclose(inner.seen.joint_angle, last[arm.joint_index], rtol=0, atol=1e-3)
    assert inner.seen.payload_mass[0] == pytest.approx(0.4, abs=0.03)
    assert "strain" in inner.seen


def test_wrong_arguments_are_rejected():
    arm = observed_link()
    with pytest.raises(fa.InputError) as caught:
        fa.ExtendedKalmanFilter(arm, [ENCODER], torque_noise=-1.0, sample_time=0.0)
    assert len(caught.value.problems) == 2
    instruments = [
        fa.Instrument("tip", noise=1e-3),
        fa.Instrument("strain"),
    ]
    with pytest.raises(fa.InputError) as caught:
        fa.ExtendedKalmanFilter(arm, instruments)
    text = str(caught.value)
    for words in (
        "'tip'",
        "no noise and no resolution",
        "'joint_angle'",
    ):
        assert words in text
    good = fa.ExtendedKalmanFilter(arm, [ENCODER])
    with pytest.raises(fa.InputError, match="joint_angle"):
        good.run(np.zeros((5, 1)), {})
    with pytest.raises(fa.InputError) as caught:
        fa.EstimatorController("a filter", None)
    assert len(caught.value.problems) == 2
