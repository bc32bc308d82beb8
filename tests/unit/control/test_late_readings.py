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
        # Relative to the initial deviations. A length of 1 m and readings of 1e-12 m leave 4 digits.
        np.testing.assert_allclose(found / own, x / own, rtol=0, atol=1e-3)
        P_found = one.covariance[:6, :6] / np.outer(own, own)
        np.testing.assert_allclose(P_found, P / np.outer(own, own), rtol=0, atol=1e-6)
        one.predict(torques[k] if k < 20 else np.zeros(1))
