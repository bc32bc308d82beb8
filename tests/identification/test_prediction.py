"""Prediction errors: against output error, exact likelihoods, the Kalman filter, disturbances."""

import warnings
from functools import cache

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import flexarm as fa
from arms import chain
from flexarm.control.filters.predicted_readings import reading_rows
from flexarm.identification import fitting, prediction
from flexarm.identification.prediction import (
    LinearModel,
    PredictedRun,
    gains_of,
    likelihoods,
)
from flexarm.identification.space import Case
from flexarm.linear.step_derivatives.sampled_step import REACH

pytestmark = pytest.mark.compiled

FREE = ["links[0].flexural_rigidity", "joints[0].hub_inertia", "joints[0].damping"]
TRUE = np.array([8.0, 0.02, 0.05])
NOISE = {"joint_angle": 2e-4, "strain": 5e-7}
RATE, DURATION = 100.0, 0.8
SAMPLES = round(DURATION * RATE) + 1


def arm_of(rigidity, inertia, damping):
    rod = {"flexural_rigidity": rigidity, "mass_per_length": 0.35, "elements": 1}
    rod["damping"] = fa.RayleighDamping(stiffness_coefficient=8e-4)
    joint = fa.Joint(hub_inertia=inertia, damping=damping)
    return chain([0.8], [joint], gauge=(0.06, 1e-3), payload=0.15, **rod)


@cache
def torque(duration=DURATION):
    return fa.multisine(0.5, (2.0, 14.0), 0.3, rise=0.1).samples(RATE, duration)


def record(seed=0, disturbance=0.0, hold=True, delay=0.0, **settings):
    """Return a record with noise, under a torque that has a random error in each sample.

    The strain is later by ``delay``, a multiple of 1 ms.
    """
    random = np.random.default_rng(seed)
    given = torque()
    acting = given + disturbance * random.standard_normal(given.shape)
    interpolation = "hold" if hold else "cubic"
    parts = 10 if delay else 1
    run = fa.simulate(
        arm_of(*TRUE),
        DURATION,
        torque=np.repeat(acting, parts, axis=0)[: round(DURATION * RATE) * parts + 1],
        rate=RATE * parts,
        torque_interpolation=interpolation,
    )
    run["strain"] = run["strain"].shift(time=round(delay * RATE * parts), fill_value=0.0)
    data = run[["torque", "joint_angle", "strain"]].isel(time=slice(None, None, parts))
    data = data.copy(deep=True)
    data["torque"][:] = given
    for name, deviation in NOISE.items():
        data[name] = data[name] + deviation * random.standard_normal(data[name].shape)
    settings = {"outputs": ["joint_angle", "strain"], "interpolation": interpolation, **settings}
    return fa.MeasuredRecord(data, **settings)


def fit(given, start=(8.6, 0.022, 0.04), **options):
    with warnings.catch_warnings():
        # Output error hardly reproduces a disturbed record.
        warnings.simplefilter("ignore", fa.FlexarmWarning)
        return fa.identify(arm_of(*start), given, FREE, progress=False, **options)


def errors(found):
    """Return the errors of the estimates, and their stated standard deviations."""
    estimates = np.array([found[path] for path in FREE])
    return estimates - TRUE, found.parameters["standard_deviation"].values


@pytest.mark.thorough
@pytest.mark.parametrize("hold", [True, False])
def test_without_process_noise_it_is_output_error(hold):
    given = record(1, hold=hold)
    reference, deviation = errors(fit(given))
    same, own = errors(fit(given, method="prediction_error", torque_noise=0.0))
    # Other steps of the integrator, and for splines a torque that is constant in parts of a sample.
    assert np.all(np.abs(same - reference) < 0.03 * deviation)
    np.testing.assert_allclose(own, deviation, rtol=0.03)


@pytest.mark.thorough
def test_estimated_process_noise_is_small_without_disturbances():
    given = record(1)
    simulated = fit(given)
    reference, deviation = errors(simulated)
    found = fit(given, method="prediction_error")
    assert simulated.converged
    assert found.converged
    # A torque noise that is nearly zero changes the estimates by a part of their deviation.
    assert np.all(np.abs(errors(found)[0] - reference) < 0.3 * deviation)
    assert found.torque_noise[0] < 2e-3
    assert simulated.torque_noise is None


@pytest.mark.thorough_cases("prediction_error")
@pytest.mark.parametrize("method", ["output_error", "prediction_error"])
def test_a_fit_whose_noise_still_changes_has_not_converged(method, monkeypatch):
    given = record(1)
    monkeypatch.setattr(fitting, "_ROUNDS", 1)
    assert not fit(given, method=method).converged


@pytest.mark.thorough
def test_disturbance_torques_bias_prediction_errors_less():
    """Random torques a third as large as the input: rigidity and inertia over three seeds."""
    missed = {"output_error": [], "prediction_error": []}
    for seed in range(3):
        given = record(seed, disturbance=0.1)
        for method, list_ in missed.items():
            found = fit(given, method=method)
            own, deviation = errors(found)
            list_.append(np.abs(own / TRUE)[:2])
            if method == "prediction_error":
                # Nine normal numbers: all below 3.5 in 996 of 1000 cases.
                assert np.all(np.abs(own) < 3.5 * deviation)
                # 81 samples determine a deviation to 8 %.
                assert found.torque_noise[0] == pytest.approx(0.1, rel=0.25)
                assert found.noise["joint_angle_1"] == pytest.approx(2e-4, rel=0.3)
                assert np.all(found.fit["whiteness"] > 1e-4)
    least = {method: np.mean(values, axis=0) for method, values in missed.items()}
    assert np.all(least["prediction_error"] < 0.4 * least["output_error"]), least


@pytest.mark.thorough
@pytest.mark.parametrize("delay", [0.013, 0.02])
def test_delays_offsets_and_gaps(delay):
    given = record(
        2,
        disturbance=0.05,
        delay=delay,
        delays={"strain": delay},
        filters={"strain": [fa.Filter("remove_mean")]},
    )
    given.data["strain"][:] += 3e-5
    given.data["strain"][30:40] = np.nan
    found = fit(given, method="prediction_error", validation={"other": record(3)})
    own, deviation = errors(found)
    assert np.all(np.abs(own) < 3.5 * deviation)
    assert found.noise["strain_1"] == pytest.approx(NOISE["strain"], rel=0.5)
    assert float(found.validation["fit"].min()) > 95.0
    late = fit(
        fa.MeasuredRecord(given.data, given.settings.replace(delays={})), method="prediction_error"
    )
    assert (
        late.fit["rms"].sel(channel="strain_1").item()
        > 3.0 * found.fit["rms"].sel(channel="strain_1").item()
    )


@pytest.mark.parametrize("delay", [0.004, 0.013, 0.02])
def test_delayed_samples_beside_a_gap_are_those_of_the_motion(delay):
    times = np.arange(SAMPLES) / RATE
    run = fa.simulate(arm_of(*TRUE), DURATION, torque=torque(), rate=RATE)
    for motion in (np.ones_like, lambda t: 1.0 + np.sin(2.0 * np.pi * t)):
        run["joint_angle"][:, 0] = motion(times - delay)
        run["joint_angle"][40:50] = np.nan
        given = fa.MeasuredRecord(run, delays={"joint_angle": delay}, outputs=["joint_angle"])
        moved = PredictedRun("record", given, arm_of(*TRUE), {})
        later = np.arange(SAMPLES) + delay * RATE
        known = ((later <= 39) | (later >= 50)) & (later <= SAMPLES - 1)
        np.testing.assert_array_equal(moved.valid[:, 0], known)
        missed = (moved.measured[:, 0] - motion(times))[moved.valid[:, 0]]
        # Less than the fourth power of 2 pi / 100, the angle of a sample.
        assert np.abs(missed).max() < 1.5e-5


def test_likelihoods_are_those_of_the_joint_distribution():
    """A small model as one normal vector of all readings, with a missing one."""
    random = np.random.default_rng(0)
    samples, n, channels, joints = 6, 3, 2, 1
    model = LinearModel(
        random.normal(0.0, 0.6, (samples - 1, n, n)),
        random.normal(size=(samples - 1, n, joints)),
        random.normal(size=(samples - 1, n)),
        random.normal(size=(channels, n)),
        random.normal(size=n),
        np.diag([0.0, 0.5, 0.0]),
    )
    measured, valid = random.normal(size=(samples, channels)), np.ones((samples, channels), bool)
    valid[2, 1] = valid[4, 0] = False
    torque_noise, noise = np.array([[0.3], [0.8]]), np.array([[0.2, 0.5], [0.4, 0.1]])
    found = likelihoods(model, measured, valid, torque_noise, noise)
    for k in range(2):
        means, parts = [model.start], [np.linalg.cholesky(model.P + 1e-30 * np.eye(n))]
        maps = [np.hstack([parts[0], np.zeros((n, (samples - 1) * joints))])]
        for j in range(samples - 1):
            means.append(model.F[j] @ means[-1] + model.b[j])
            step = model.F[j] @ maps[-1]
            step[:, n + j] += model.G[j, :, 0] * torque_noise[k, 0]
            maps.append(step)
        rows = np.concatenate([model.H @ one for one in maps])
        mean = np.concatenate([model.H @ one for one in means])
        covariance = rows @ rows.T + np.diag(np.tile(noise[k] ** 2, samples))
        kept = valid.ravel()
        exact = multivariate_normal(mean[kept], covariance[np.ix_(kept, kept)])
        constant = 0.5 * kept.sum() * np.log(2.0 * np.pi)
        expected = -exact.logpdf(measured.ravel()[kept]) - constant
        assert found[k] == pytest.approx(expected, rel=1e-9)
        gains = gains_of(model, valid, torque_noise[k], noise[k])
        assert np.all(gains.K[2, :, 1] == 0.0)


def test_predictions_are_those_of_the_extended_kalman_filter(monkeypatch):
    monkeypatch.setattr(prediction, "_REACH", REACH)  # the same steps
    given = record(4, disturbance=0.1)
    arm = arm_of(*TRUE)
    run = PredictedRun("record", given, arm, {})
    case = Case(arm.spec, None, np.zeros(arm.dof), np.zeros(arm.dof))
    noise, torque_noise = np.array(list(NOISE.values())), np.array([0.1])
    run.gains = gains_of(run.linearised(case, torque_noise, noise), run.valid, torque_noise, noise)
    (predicted,) = run.simulate([case])
    instruments = [fa.Instrument(name, noise=value) for name, value in NOISE.items()]
    known = fa.ExtendedKalmanFilter(arm, instruments, sample_time=1.0 / RATE, torque_noise=0.1)
    size = 2 * arm.dof + 1
    known.begin(run.state(arm, case)[0], np.zeros(arm.dof), 0.15, np.zeros((size, size)))
    angle, strain = run.measured.T
    rows = reading_rows(arm, instruments[1])[0, : arm.dof]
    for k in range(len(angle)):
        if k:
            known.predict(torque()[k - 1])
        expected = [known.q[0], rows @ known.q]
        np.testing.assert_allclose(predicted[k], expected, rtol=1e-7, atol=1e-12)
        known.correct(fa.Measurement(joint_angle=angle[k : k + 1], strain=strain[k : k + 1]))


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"outputs": ["joint_angle", "tip"]}, "outputs: tip is not supported with prediction_err"),
        ({"prescribed": [1]}, "prescribed is not supported with prediction_error"),
        (
            {"filters": {"strain": [fa.Filter("low_pass", cutoff=20.0)]}},
            "filters: strain low_pass is not supported",
        ),
    ],
)
def test_records_that_are_not_supported(settings, text):
    run = fa.simulate(arm_of(*TRUE), 0.1, torque=torque()[:11], rate=RATE)
    given = fa.MeasuredRecord(run, **{"outputs": ["joint_angle", "strain"], **settings})
    with pytest.raises(fa.InputError, match=text):
        fit(given, method="prediction_error")


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"method": "least_squares"}, "method must be one of"),
        ({"torque_noise": 0.1}, "torque_noise requires method='prediction_error'"),
        ({"method": "prediction_error", "loss": "huber"}, "huber cannot be combined"),
        ({"method": "prediction_error", "torque_noise": -0.1}, "torque_noise must not be negative"),
        ({"method": "prediction_error", "torque_noise": [0.1, 0.1]}, r"shape \(1,\)"),
    ],
)
def test_wrong_arguments(options, text):
    with pytest.raises(fa.InputError, match=text):
        fit(record(), **options)
