"""The moving-horizon estimator against the Kalman filter, and with bounds."""

import driven_link
import numpy as np
import pytest
from scipy.optimize import OptimizeResult, lsq_linear

import flexarm as fa
from flexarm.model.paths import with_numbers

SCALE = 1e-10  # a factor on all motions: quadratic terms of the arm are this much smaller
ENCODER = fa.Instrument("joint_angle", noise=2e-4 * SCALE)
STRAIN = fa.Instrument("strain", noise=3e-6 * SCALE)
SENSOR = fa.Sensor("acceleration", link=1, frame="link", name="accelerometer")
ACCELEROMETER = fa.Instrument(SENSOR, noise=0.05 * SCALE)


BOUND = driven_link.FRICTION


@pytest.mark.sampled("instruments1-6", "instruments0-1")
@pytest.mark.parametrize("horizon", [1, 6])
@pytest.mark.parametrize("instruments", [[ENCODER, STRAIN], [ENCODER, ACCELEROMETER]])
def test_estimates_of_a_linear_arm_equal_those_of_the_kalman_filter(horizon, instruments):
    arm, random = driven_link.one_link(0.0), np.random.default_rng(3)
    options = {
        "torque_noise": 0.1 * SCALE,
        "disturbance_deviation": 0.5 * SCALE,
        "disturbance_drift": 2.0 * SCALE,
        "sample_time": 2e-3,
    }
    filters = fa.ExtendedKalmanFilter(arm, instruments, **options)
    horizons = fa.MovingHorizonEstimator(arm, instruments, horizon=horizon, **options)
    deviation = SCALE * np.array([1e-3, 2e-3, 0.1, 0.05, 0.5, 0.0])
    for one in (filters, horizons):
        one.begin(np.zeros(2), np.zeros(2), 0.2, np.diag(deviation**2))
    for _ in range(15):
        readings = {
            i.label: i.noise * random.normal(size=1 + (i is ACCELEROMETER)) for i in instruments
        }
        found = []
        for one in (filters, horizons):
            one.correct(fa.Measurement(**readings))
            found.append(np.concatenate([one.q, one.qd, one.disturbance]) / deviation[:5])
        # Relative to the initial deviations; covariances to those of the filter.
        np.testing.assert_allclose(*found, rtol=0, atol=1e-9)
        own = np.sqrt(np.diag(filters.covariance))[:5]
        P = [(one.covariance[:5, :5] / np.outer(own, own)) for one in (filters, horizons)]
        np.testing.assert_allclose(*P, rtol=0, atol=1e-8)
        squared = [one._latest.squared for one in (filters, horizons)]
        assert squared[1] == pytest.approx(squared[0], rel=1e-7)
        torque = SCALE * random.normal(size=1)
        for one in (filters, horizons):
            one.predict(torque)


@pytest.mark.thorough
def test_bounds_reduce_the_errors_of_a_friction_near_zero():
    """Friction up to 0.02 N m, believed 0.05 with a deviation of 0.3, and a disturbance torque."""
    arm = driven_link.one_link(0.05)
    deviations = np.array([1e-3, 2e-3, 0.1, 0.05, 0.3, 0.5, 0.0])
    instruments = [driven_link.ENCODER, driven_link.STRAIN]
    options = {
        "torque_noise": 0.05,
        "parameters": {BOUND: 0.3},
        "disturbance_deviation": 0.5,
        "sample_time": 2e-3,
    }
    filters = fa.ExtendedKalmanFilter(arm, instruments, **options)
    horizons = fa.MovingHorizonEstimator(
        arm, instruments, horizon=10, lower_bounds={BOUND: 0.0}, **options
    )
    errors: list[list[np.ndarray]] = [[], []]
    least = [0.0, 0.0]
    for seed in range(5):
        random = np.random.default_rng([seed, 7])
        drawn, friction = deviations * random.standard_normal(7), 0.02 * random.random()
        plant = fa.Arm(with_numbers(arm.spec, {BOUND: friction}))
        _, torque, readings = driven_link.record(
            plant, seed, 0.05, drawn[5], 0.1, initial=drawn[:2], initial_rate=drawn[2:4]
        )
        for place, one in enumerate((filters, horizons)):
            one.reset()
            one.begin(np.zeros(2), np.zeros(2), 0.2, np.diag(deviations**2))
            for k in range(len(torque)):
                if k:
                    one.predict(torque[k - 1])
                one.correct(fa.Measurement(**{n: v[k] for n, v in readings.items()}))
                found = one.parameter_values[BOUND]
                least[place] = min(least[place], found)
                if k >= 10:
                    errors[place].append([found - friction, one.disturbance[0] - drawn[5]])
    rms = [np.sqrt(np.mean(np.square(one), axis=0)) for one in errors]
    # Measured ratios: 0.73 for friction, 0.77 for the disturbance, which a wrong friction biases.
    assert np.all(rms[1] < 0.85 * rms[0])
    assert least[1] == 0.0 > least[0]


def test_wrong_bounds_are_rejected():
    arm = driven_link.one_link()
    known = {"parameters": {BOUND: 0.1}, "payload_deviation": 0.1}
    for options, words in (
        ({"lower_bounds": {"payload.inertia": 0.0}}, "have names of uncertain numbers"),
        ({"upper_bounds": {"disturbance": 1.0}}, "joints.0..friction.coulomb, payload.mass"),
        ({"lower_bounds": {BOUND: 0.2}, "upper_bounds": {BOUND: 0.1}}, "exceed the lower bound"),
        ({"lower_bounds": {BOUND: 0.5}}, "contain the value of the arm"),
        (
            {"disturbance_deviation": 1.0, "lower_bounds": {"disturbance": 0.1}},
            "contain the start of the disturbance, got 0",
        ),
        ({"horizon": 0}, "horizon"),
    ):
        with pytest.raises(fa.InputError, match=words):
            fa.MovingHorizonEstimator(arm, [driven_link.ENCODER], **known, **options)


def test_samples_without_readings_are_predicted():
    """Missing readings in the middle of a horizon widen the deviations, until the next ones."""
    arm = driven_link.one_link()
    one = fa.MovingHorizonEstimator(arm, [driven_link.ENCODER], torque_noise=0.05, horizon=3)
    reading = fa.Measurement(joint_angle=np.array([0.1]))
    one.correct(reading)
    found = []
    for k in range(6):
        one.predict(np.zeros(1))
        if k not in (2, 3):
            one.correct(reading)
        found.append(one.deviations["q"][0])
    assert found[1] < found[2] < found[3] > found[4]
    assert one.q[0] == pytest.approx(0.1, abs=4.0 * found[5])


def test_a_mass_that_only_begin_makes_uncertain_is_not_negative():
    """A payload of 0.001 kg, estimated from noisy readings."""
    arm = driven_link.one_link()
    instruments = [driven_link.ENCODER, driven_link.STRAIN]
    one = fa.MovingHorizonEstimator(arm, instruments, horizon=3, sample_time=2e-3)
    plant = fa.Arm(with_numbers(arm.spec, {"payload.mass": 0.001}))
    _, torque, readings = driven_link.record(plant, 1, 0.1, duration=0.1)
    one.begin(np.zeros(2), np.zeros(2), 0.02, np.diag([1e-3, 2e-3, 0.1, 0.05, 0.1]) ** 2)
    found = []
    for k in range(len(torque)):
        if k:
            one.predict(torque[k - 1])
        one.correct(fa.Measurement(**{n: v[k] for n, v in readings.items()}))
        found.append(one.payload_mass)
    assert min(found) == 0.0


@pytest.mark.thorough
def test_perfectly_correlated_numbers_keep_their_ratio():
    """The damping is a fixed multiple of the disturbance; the Kalman filter is the reference."""
    arm, random = driven_link.one_link(0.0), np.random.default_rng(3)
    path = "joints[0].damping"
    options = {
        "torque_noise": 0.1 * SCALE,
        "parameters": {path: 1e-7},
        "disturbance_deviation": 0.5 * SCALE,
        "sample_time": 2e-3,
    }
    kinds = fa.ExtendedKalmanFilter, fa.MovingHorizonEstimator
    filters, horizons = (kind(arm, [ENCODER], **options) for kind in kinds)
    deviation = np.array([1e-3 * SCALE, 2e-3 * SCALE, 0.1 * SCALE, 0.05 * SCALE, 0, 0, 0])
    along = np.array([0.0, 0.0, 0.0, 0.0, 1e-7, 0.5 * SCALE, 0.0])
    for one in (filters, horizons):
        one.begin(np.zeros(2), np.zeros(2), 0.2, np.diag(deviation**2) + np.outer(along, along))
    for k in range(30):
        angle = SCALE * (2e-3 * k) ** 2 + ENCODER.noise * random.normal(size=1)
        for one in (filters, horizons):
            one.correct(fa.Measurement(joint_angle=angle))
        changes = [
            [(one.parameter_values[path] - 0.1) / 1e-7, one.disturbance[0] / (0.5 * SCALE)]
            for one in (filters, horizons)
        ]
        # Relative to the deviations. The horizon replaces the zero variance by 1e-12.
        np.testing.assert_allclose(*changes, rtol=0, atol=1e-6)
        for one in (filters, horizons):
            one.predict(np.zeros(1))
    assert abs(changes[1][0]) > 0.1
    assert changes[1][0] == pytest.approx(changes[1][1], abs=1e-6)


def _stalled(*args, **options):
    return OptimizeResult(lsq_linear(*args, **options) | {"status": -1})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("flexarm.control.filters.moving_horizon._MOST", 1),
        ("flexarm.control.filters.moving_horizon._HALVINGS", -1),
        ("scipy.optimize.lsq_linear", _stalled),
    ],
)
def test_estimates_that_do_not_converge_are_counted_and_reported_once(monkeypatch, name, value):
    arm = driven_link.one_link()
    one = fa.MovingHorizonEstimator(arm, [driven_link.ENCODER], horizon=3, sample_time=2e-3)
    reading = fa.Measurement(joint_angle=np.array([0.1]))
    one.correct(reading)
    assert one.report()["estimator_unconverged"] == 0
    monkeypatch.setattr(name, value)
    one.predict(np.ones(1))
    with pytest.warns(fa.AccuracyWarning, match=r"t = 0\.002 s .* did not converge"):
        one.correct(reading)
    one.predict(np.ones(1))
    one.correct(reading)  # no second warning, which would be an error
    assert one.report()["estimator_unconverged"] == 2
    monkeypatch.undo()
    one.predict(np.ones(1))
    one.correct(reading)
    assert one.report()["estimator_unconverged"] == 2
    one.reset()
    assert one.report()["estimator_unconverged"] == 0
