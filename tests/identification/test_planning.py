"""Planned experiments: predicted deviations against estimates, and optimal excitation."""

import warnings

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import flexarm as fa
from data.bench_records import ONE
from identification.benches import FREE, NOISE, arm_of

pytestmark = pytest.mark.compiled

RIGIDITY = "links[0].flexural_rigidity"
#: Noise of the channels of the bench.
MEASURED = {name: NOISE[name] for name in ("joint_angle", "strain")}
LIMITS = fa.MotionLimits(torque=0.3, strain=1e-4, joint_angle=(-0.5, 0.5))


def shaken(arm, seconds=1.5, peak=0.3):
    torque = fa.multisine(1.0, (1.0, 12.0), peak, rise=0.25)
    return fa.simulate(arm, seconds, torque=torque.samples(200.0, seconds), rate=200.0)


#: Two inertias that no experiment distinguishes.
INERTIAS = ["joints[0].hub_inertia", "joints[0].rotor_inertia"]


def geared():
    spec = arm_of(ONE, 1).spec
    return fa.Arm(spec.replace(joints=[spec.joints[0].replace(rotor_inertia=0.002)]))


def planned(result, **settings):
    given = {"outputs": list(MEASURED), "noise": MEASURED, **settings}
    return fa.MeasuredRecord(result, interpolation="cubic", **given)


def with_noise(result, seed):
    random = np.random.default_rng(seed)
    data = result.copy()
    for name, deviation in MEASURED.items():
        data[name] = data[name] + deviation * random.standard_normal(data[name].shape)
    return data


@pytest.mark.thorough
def test_predicted_deviations_are_those_of_estimates():
    arm, free = arm_of(ONE), FREE[ONE.name]
    result = shaken(arm)
    plan = fa.identifiability(arm, planned(result), free)
    assert plan.undetermined == ()
    scores, stated = [], []
    for seed in range(8):
        found = fa.identify(arm, planned(with_noise(result, seed)), free, progress=False)
        errors = found.parameters["estimate"] - plan.parameters["estimate"]
        scores.append((errors / plan.parameters["standard_deviation"]).values)
        stated.append(found.parameters["standard_deviation"].values)
    # The deviations that are stated are taken at the estimates and contain the correlation of the
    # residuals that chance makes.
    predicted = plan.parameters["standard_deviation"].values
    np.testing.assert_allclose(np.median(stated, axis=0), predicted, rtol=0.1)
    # 48 correlated numbers: their RMS has a relative deviation of about 0.15.
    assert 0.6 < np.sqrt(np.mean(np.square(scores))) < 1.4


def test_the_values_of_the_record_do_not_count():
    arm = arm_of(ONE)
    result = shaken(arm, 0.5)
    plan = fa.identifiability(arm, planned(result), [RIGIDITY, "joints[0].damping"])
    other = result.copy()
    other["strain"] = other["strain"] + 1.0
    again = fa.identifiability(arm, planned(other), [RIGIDITY, "joints[0].damping"])
    np.testing.assert_array_equal(plan.information, again.information)
    relative = plan.parameters["standard_deviation"] / plan.parameters["estimate"]
    covariance = np.linalg.inv(plan.information)
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), relative, rtol=1e-6)
    assert plan.log_determinant == pytest.approx(-np.linalg.slogdet(covariance)[1])
    twice = fa.identifiability(
        arm, {"a": planned(result), "b": planned(other)}, [RIGIDITY, "joints[0].damping"]
    )
    assert twice[RIGIDITY] == pytest.approx(plan[RIGIDITY] / np.sqrt(2.0), rel=1e-6)


def test_what_sensors_determine():
    """The distance of a gauge is known from strain together with the joint angle only."""
    arm = arm_of(ONE)
    result = shaken(arm, 1.0)
    free = [RIGIDITY, "links[0].gauges[0].distance", "joints[0].hub_inertia"]
    angle = fa.identifiability(arm, planned(result, outputs=["joint_angle"]), free)
    assert len(angle.undetermined) == 1
    assert "the distance of gauge 1 of link 1" in angle.undetermined[0]
    assert angle["links[0].gauges[0].distance"] == np.inf
    assert angle.log_determinant == -np.inf
    both = fa.identifiability(arm, planned(result), free)
    assert both.undetermined == ()
    assert both[RIGIDITY] < angle[RIGIDITY]
    unclear = fa.identifiability(geared(), planned(result), INERTIAS)
    assert "do not distinguish" in unclear.undetermined[0]
    assert unclear[INERTIAS[0]] > 1.0
    prior = [INERTIAS[0], fa.FreeParameter(INERTIAS[1], prior_deviation=1e-4)]
    known = fa.identifiability(geared(), planned(result), prior)
    assert known[INERTIAS[1]] == pytest.approx(1e-4, rel=1e-3)
    assert "rotor_inertia" in str(known)


def test_a_record_without_motion_determines_nothing():
    arm = arm_of(ONE)
    still = fa.simulate(arm, 0.2, rate=200.0)[["joint_angle", "strain"]]
    plan = fa.identifiability(arm, planned(still, input="none"), [RIGIDITY, "joints[0].damping"])
    assert np.all(np.isinf(plan.parameters["standard_deviation"]))
    assert np.isfinite(plan.parameters["correlation"]).all()
    (sentence,) = plan.undetermined
    assert "rigidity of link 1 and damping of joint 1: their standard deviations" in sentence
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        record = planned(with_noise(still, 1), input="none")
        found = fa.identify(arm, record, [RIGIDITY], progress=False)
    assert found.parameters["standard_deviation"].values.tolist() == [np.inf]


@pytest.fixture(scope="module")
def optimal():
    return fa.optimal_excitation(
        arm_of(ONE, 1),
        [RIGIDITY, "joints[0].damping", "links[0].damping.stiffness_coefficient"],
        LIMITS,
        noise=MEASURED,
        period=1.0,
        band=(1.0, 10.0),
        lines=4,
        duration=1.0,
        iterations=8,
    )


def excess(run, torque):
    """Return the largest relative excess over the limits."""
    return max(
        float(np.abs(torque).max()) / 0.3,
        float(np.abs(run["strain"]).max()) / 1e-4,
        float(np.abs(run["joint_angle"]).max()) / 0.5,
    )


@pytest.mark.thorough
def test_an_optimal_excitation_is_better_than_random_ones_within_the_same_limits(optimal):
    arm = arm_of(ONE, 1)
    free = optimal.identifiability.parameters["parameter"].values.tolist()
    assert optimal.gain > 1.2
    assert excess(optimal.run, optimal.samples) <= 1.0
    # A limit is reached, to the last halving of the amplitude.
    assert excess(optimal.run, optimal.samples) > 0.99
    random = np.random.default_rng(5)
    for _ in range(6):
        shape = optimal.torque.coefficients.shape
        phases = np.exp(2j * np.pi * random.uniform(size=shape))
        torque = fa.Multisine(1.0, optimal.torque.harmonics, phases, optimal.torque.rise)
        for _ in range(12):  # the motion is nearly linear in the torque
            samples = torque.samples(200.0, 1.0)
            run = fa.simulate(arm, 1.0, torque=samples, rate=200.0)
            torque = torque.scaled(1.0 / excess(run, samples))
        assert excess(run, samples) == pytest.approx(1.0, abs=1e-3)
        other = fa.identifiability(arm, planned(run), free)
        assert other.log_determinant < optimal.identifiability.log_determinant


@pytest.mark.thorough
def test_an_optimal_excitation_is_smooth_and_periodic(optimal):
    torque = optimal.torque
    assert torque(0.0) == 0.0
    np.testing.assert_allclose(torque(1.7), torque(0.7), atol=1e-15)
    assert set(torque.harmonics) <= set(range(1, 11))
    np.testing.assert_array_equal(optimal.run["torque"], optimal.samples)


def small(limits, **settings):
    """Return a short optimal excitation with few lines."""
    given = {"period": 0.5, "band": (2.0, 8.0), "lines": 2, "duration": 0.5, "iterations": 1}
    arm, free = arm_of(ONE, 1), [RIGIDITY, "joints[0].damping"]
    return fa.optimal_excitation(arm, free, limits, noise=MEASURED, **given | settings)


# Two samples per period of the highest sine: their central differences are too small. The spline
# reaches the limit in the first case, the torque in the second one.
@pytest.mark.thorough
@pytest.mark.parametrize(("band", "lines"), [((30.0, 45.0), 2), ((20.0, 44.0), 3)])
def test_the_torque_rate_is_limited_also_between_samples(band, lines):
    found = small(fa.MotionLimits(torque_rate=5.0), band=band, lines=lines, rate=100.0)
    times = np.linspace(0.0, 0.5, 50_001)
    spline = CubicSpline(np.arange(51) / 100.0, found.samples[:, 0])
    rates = [
        np.diff(found.torque(times)[:, 0]) / 1e-5,
        spline(times, 1),
        np.diff(found.samples[:, 0]) * 100.0,
    ]
    # Peaks between the points at which the rate is limited are at most 0.2 % higher.
    assert [float(np.abs(rate).max()) < 1.002 * 5.0 for rate in rates] == [True, True, True]
    assert max(np.abs(rate).max() for rate in rates) > 0.99 * 5.0


@pytest.mark.thorough
def test_an_optimal_excitation_keeps_clear_of_obstacles():
    walls = [fa.Wall((0.0, -0.02), (0.0, 1.0)), fa.Wall((0.0, 0.02), (0.0, -1.0))]
    found = small(fa.MotionLimits(torque=10.0, obstacles=walls, clearance=0.005))
    # The limit is reached, to the last halving of the amplitude, far below that of the torque.
    assert 0.99 * 0.015 < np.abs(found.run["tip"].sel(axis="y")).max() <= 0.015
    assert np.abs(found.samples).max() < 1.0


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"limits": fa.MotionLimits()}, "limits must contain at least one limit"),
        ({"limits": fa.MotionLimits(clearance=0.1)}, "limits must contain at least one limit"),
        ({"limits": fa.MotionLimits(joint_angle=(0.2, 0.5))}, "limits exclude the start"),
        ({"noise": {}}, "noise must not be empty"),
        ({"noise": {"strian": 1e-6}}, "strian"),
        ({"arm": fa.Arm(arm_of(ONE, 1).spec.replace(gravity=(0.0, -9.81)))}, "gravity"),
        ({"arm": geared, "free": INERTIAS}, "does not determine. The data do not distinguish"),
        ({"rate": 15.0}, "rate must be greater than 20 Hz"),
    ],
)
def test_wrong_arguments_of_an_excitation(arguments, text):
    given = {
        "arm": arm_of(ONE, 1),
        "free": [RIGIDITY],
        "limits": LIMITS,
        "noise": MEASURED,
        "period": 0.5,
        "band": (2.0, 10.0),
        "duration": 0.5,
        "iterations": 1,
        **arguments,
    }
    if callable(given["arm"]):
        given["arm"] = given["arm"]()
    with pytest.raises(fa.InputError, match=text):
        fa.optimal_excitation(**given)
