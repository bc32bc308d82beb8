"""Filters with readings that arrive late or seldom, and with unknown biases."""

import driven_link
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

import flexarm as fa

SCALE = 1e-8  # a factor on all motions: quadratic terms of the arm are this much smaller
SAMPLE_TIME = 2e-3
TIP = fa.Sensor("position", link=1, name="camera")
#: Encoder and gyroscope of the joint, a late camera at every third sample, and late strains.
ENCODER = fa.Instrument("joint_angle", noise=2e-4 * SCALE)
RATE = fa.Instrument("joint_rate", noise=0.02 * SCALE)
CAMERA = fa.Instrument(TIP, noise=1e-4 * SCALE, delay=0.0105, sample_time=0.006)
STRAIN = fa.Instrument("strain", noise=3e-6 * SCALE, delay=0.004)
INSTRUMENTS = [ENCODER, RATE, CAMERA, STRAIN]
#: Stride and delay in samples: a delay of 5.25 samples is one of six.
FRAMES = {"joint_angle": (1, 0), "joint_rate": (1, 0), "camera": (3, 6), "strain": (1, 2)}
#: Deviations of q, qd, of the biases of the rate and the strain, and of the payload.
DEVIATIONS = SCALE * np.array([1e-3, 2e-3, 0.1, 0.05, 0.05, 2e-5, 0.0])
OPTIONS = {
    "torque_noise": 0.1 * SCALE,
    "bias_deviation": {"joint_rate": 0.05 * SCALE, "strain": 2e-5 * SCALE},
    "bias_drift": {"joint_rate": 0.1 * SCALE},
    "sample_time": SAMPLE_TIME,
}
KINDS = {
    "extended": fa.ExtendedKalmanFilter,
    "unscented": fa.UnscentedKalmanFilter,
    "moving_horizon": lambda *given, **more: fa.MovingHorizonEstimator(*given, horizon=4, **more),
}


class Linear:
    """A Kalman filter of the linear arm that starts again at every sample, with all that is known.

    The camera reads (length, deflection of the tip); the first is constant on a linear arm.
    """

    def __init__(self, arm):
        model = fa.linearize(arm, outputs=["joint_angle", "joint_rate", TIP, "strain"])
        n, names = 4, ["joint_angle", "joint_rate", "camera", "camera", "strain"]
        block = np.block([[model.A, model.B], [np.zeros((1, n + 1))]])
        whole = expm(SAMPLE_TIME * block)
        self.F, self.G = np.eye(6), np.zeros((6, 1))
        self.F[:n, :n], self.G[:n] = whole[:n, :n], whole[:n, n:]
        self.C = np.zeros((5, 6))
        self.C[:, :n] = model.C
        self.C[1, 4] = self.C[4, 5] = 1.0
        noise = {item.label: item.noise for item in INSTRUMENTS}
        self.names, self.R = np.array(names), np.array([noise[name] ** 2 for name in names])
        self.Q = OPTIONS["torque_noise"] ** 2 * self.G @ self.G.T
        self.Q[4, 4] += SAMPLE_TIME * OPTIONS["bias_drift"]["joint_rate"] ** 2

    def estimate(self, torques, readings):
        """Return the mean and covariance at the last sample.

        Args:
            torques: (samples - 1,) readings: (samples, 5) as they were seen.
        """
        last = len(readings) - 1
        x, P = np.zeros(6), np.diag(DEVIATIONS[:6] ** 2)
        for k in range(last + 1):
            if k:
                x = self.F @ x + self.G @ torques[k - 1]
                P = self.F @ P @ self.F.T + self.Q
            for row, name in enumerate(self.names):
                every, late = FRAMES[name]
                if k % every == 0 and k + late <= last:
                    C = self.C[row]
                    K = P @ C / (C @ P @ C + self.R[row])
                    x, P = x + K * (readings[k + late, row] - C @ x), P - np.outer(K, C @ P)
        return x, P


@pytest.mark.sampled("extended")
@pytest.mark.parametrize("kind", KINDS)
def test_estimates_of_a_linear_arm_equal_those_of_a_kalman_filter_with_all_arrived_readings(kind):
    arm, random = driven_link.one_link(0.0), np.random.default_rng(4)
    one = KINDS[kind](arm, INSTRUMENTS, **OPTIONS)
    one.begin(np.zeros(2), np.zeros(2), 0.2, np.diag(DEVIATIONS**2))
    oracle, straight = Linear(arm), np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    torques, readings = SCALE * random.normal(size=(20, 1)), np.zeros((21, 5))
    own = DEVIATIONS[:6]
    for k in range(21):
        readings[k] = np.sqrt(oracle.R) * random.normal(size=5)
        angle, rate, *tip, strain = np.split(readings[k] + straight, 5)
        values = {"joint_angle": angle, "joint_rate": rate, "strain": strain}
        one.correct(fa.Measurement(camera=np.concatenate(tip), **values))
        x, P = oracle.estimate(torques, readings[: k + 1])
        found = np.concatenate([one.q, one.qd, *one.biases.values()])
        # Relative to the initial deviations; 1 m and readings of 1e-12 m leave four digits.
        np.testing.assert_allclose(found / own, x / own, rtol=0, atol=1e-3)
        P_found = one.covariance[:6, :6] / np.outer(own, own)
        np.testing.assert_allclose(P_found, P / np.outer(own, own), rtol=0, atol=1e-6)
        one.predict(torques[k] if k < 20 else np.zeros(1))


#: Instruments of a link in motion, with true biases that are drawn.
SEEN = [
    driven_link.ENCODER,
    fa.Instrument("strain", noise=3e-6),
    fa.Instrument(TIP, noise=2e-4, delay=0.015, sample_time=0.01),
]
WRONG = {"joint_angle": 2e-3, "strain": 3e-5}


def drawn_run(seed, kind="extended"):
    """Return a filter of a link with drawn start, biases and payload, estimates and errors."""
    random = np.random.default_rng([seed, 3])
    start = np.array([1e-3, 2e-3, 0.1, 0.05]) * random.standard_normal(4)
    biases = {name: size * random.standard_normal() for name, size in WRONG.items()}
    arm, mass = driven_link.one_link(), 0.2 + 0.05 * random.standard_normal()
    plant = fa.varied(arm, payload_mass=mass)
    instruments = [item.replace(bias=biases.get(item.label, 0.0)) for item in SEEN]
    run, torque, readings = driven_link.record(
        plant, seed, 0.05, instruments=instruments, initial=start[:2], initial_rate=start[2:]
    )
    known = {"torque_noise": 0.05, "payload_deviation": 0.05, "sample_time": SAMPLE_TIME}
    one = KINDS[kind](arm, SEEN, bias_deviation=WRONG, **known)
    # The filter starts at its first readings, with wider deviations than those of the start.
    found = one.run(torque, readings)
    count = len(torque)
    true = run.q.values[:count], run.qd.values[:count], mass
    return one, found, found.squared_errors(*true, biases=biases), biases


@pytest.mark.thorough
def test_errors_have_the_covariance_of_the_filter():
    """A camera that is late, and biases of encoder and gauge, which only the camera shows."""
    total, runs = np.zeros(2), 12
    for seed in range(runs):
        _, found, squared, _ = drawn_run(seed)
        total += squared[[-40, -1]]
        assert found.consistent
        deviation = found.deviations["bias of joint_angle"][:, 0]
        assert deviation[-1] < 0.1 * deviation[0]
    # Seeds are fixed; with others the test would fail once in a hundred times.
    low, high = chi2.ppf([0.0025, 0.9975], 7 * runs) / 7
    assert np.all((low < total) & (total < high))


@pytest.mark.thorough
def test_without_the_bias_or_the_delay_the_filter_is_inconsistent():
    arm = driven_link.one_link()
    instruments = [item.replace(bias=WRONG.get(item.label, 0.0)) for item in SEEN]
    _, torque, readings = driven_link.record(arm, 1, instruments=instruments)
    options = {"torque_noise": 0.05, "sample_time": SAMPLE_TIME}
    early = [item.replace(delay=0.0) for item in SEEN]
    for seen, wrong in ((SEEN, {}), (early, WRONG)):
        with pytest.warns(fa.InconsistentEstimateWarning):
            fa.ExtendedKalmanFilter(arm, seen, bias_deviation=wrong, **options).run(
                torque, readings
            )
    right = fa.ExtendedKalmanFilter(arm, SEEN, bias_deviation=WRONG, **options)
    assert right.run(torque, readings).consistent


@pytest.mark.sampled("extended")
@pytest.mark.parametrize("kind", KINDS)
def test_results_of_a_loop_report_biases(kind):
    """The controller receives the estimates that the filter has along the record of the run."""
    arm = driven_link.one_link()
    instruments = [item.replace(bias=WRONG.get(item.label, 0.0)) for item in SEEN]
    options = {"torque_noise": 0.05, "bias_deviation": WRONG}
    one = KINDS[kind](arm, SEEN, **options)
    inner = fa.JointPD(20.0, 2.0, sample_time=SAMPLE_TIME)
    run = fa.simulate(
        arm,
        0.06,
        controller=fa.EstimatorController(one, inner),
        reference=fa.joint_motion(arm, [0.0], [0.05], 0.06),
        hardware=fa.Hardware(instruments, seed=2),
        rate=500.0,
    )
    again = KINDS[kind](arm, SEEN, **options, sample_time=SAMPLE_TIME)
    readings = {item.label: run[f"measured_{item.label}"].values for item in SEEN}
    found = again.run(run.torque_command.values[: len(readings["strain"])], readings)
    for name in WRONG:
        key = f"bias of {name}[0]"
        assert run.attrs[f"estimated {key}"] == found.biases[name][-1, 0]
        assert run.attrs[f"deviation of {key}"] == found.deviations[f"bias of {name}"][-1, 0]
    assert run.attrs["estimated bias of joint_angle[0]"] != 0.0


@pytest.mark.thorough
def test_number_of_readings_of_each_sample():
    _, found, _, _ = drawn_run(0)
    wanted = np.full(100, 2)
    wanted[::5] = 4  # the camera, every 10 ms
    wanted[-5:] = 2  # its frame at 190 ms arrives at 205 ms
    np.testing.assert_array_equal(found.readings, wanted)
    low, high = found.innovation_band(0.9)
    for size in (2, 4):
        chosen = found.readings == size
        np.testing.assert_allclose(low[chosen], chi2.ppf(0.05, size) / size)
        np.testing.assert_allclose(high[chosen], chi2.ppf(0.95, size) / size)


def readings_at(k):
    values = {"joint_angle": np.array([0.01 * k]), "strain": np.array([1e-5 * k])}
    return fa.Measurement(camera=np.array([1.0, 0.01 * k]), **values)


@pytest.mark.sampled("extended", "unscented")
@pytest.mark.parametrize("kind", KINDS)
def test_a_second_correction_of_a_sample_replaces_the_first(kind):
    one, other = (
        KINDS[kind](driven_link.one_link(), SEEN, sample_time=SAMPLE_TIME) for _ in range(2)
    )
    for each in (one, other):
        each.begin(np.zeros(2), np.zeros(2), 0.2, np.diag([1e-3, 2e-3, 0.1, 0.05, 0.0]) ** 2)
    for k in range(12):
        one.correct(readings_at(k))
        other.correct(readings_at(k + 1))
        other.correct(readings_at(k))
        for each in (one, other):
            each.predict(np.zeros(1))
    np.testing.assert_array_equal(one.q, other.q)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_the_first_correction_is_the_first_sample():
    """A prediction before it, which has no estimate yet, does not shift the frames."""
    one, other = (
        fa.ExtendedKalmanFilter(driven_link.one_link(), SEEN, sample_time=SAMPLE_TIME)
        for _ in range(2)
    )
    one.predict(np.zeros(1))
    for k in range(20):
        for each in (one, other):
            each.correct(readings_at(k))
            each.predict(np.zeros(1))
    np.testing.assert_array_equal(one.q, other.q)


@pytest.mark.parametrize("kind", KINDS)
def test_samples_without_readings_are_predicted(kind):
    """A camera whose frames arrive after samples without any correction."""
    one = KINDS[kind](driven_link.one_link(), SEEN, sample_time=SAMPLE_TIME)
    found = []
    for k in range(30):
        if k < 3 or k > 20:
            one.correct(readings_at(0))
        found.append(one.deviations["q"][0])
        one.predict(np.zeros(1))
    assert found[2] < found[12] < found[20] > found[21]
    assert one.q[0] == pytest.approx(0.0, abs=4.0 * found[-1])


@pytest.mark.thorough
def test_wrong_arguments_are_rejected_together():
    arm = driven_link.one_link()
    with pytest.raises(fa.InputError) as caught:
        fa.ExtendedKalmanFilter(
            arm, SEEN, bias_deviation={"gyroscope": 0.1}, bias_drift={"tip": 0.1}
        )
    rule = "have names of instruments of the filter (joint_angle, strain, camera)"
    assert [problem.rule for problem in caught.value.problems] == [rule, rule]
    one = fa.ExtendedKalmanFilter(arm, SEEN, sample_time=3e-3)
    with pytest.raises(fa.InputError, match="sample_time of 'camera' must be a multiple of"):
        one.correct(readings_at(0))
    with pytest.raises(fa.InputError, match="bias_deviation"):
        fa.ExtendedKalmanFilter(arm, SEEN, bias_deviation={"strain": -1.0})
    _, found, _, _ = drawn_run(0)
    with pytest.raises(
        fa.InputError, match=r"biases must have the instruments joint_angle, strain"
    ):
        found.squared_errors(found.q, found.qd, 0.2)
    with pytest.raises(fa.InputError, match=r"biases\['strain'\] must have shape"):
        found.squared_errors(
            found.q, found.qd, 0.2, biases={"joint_angle": 0.0, "strain": np.zeros(3)}
        )
