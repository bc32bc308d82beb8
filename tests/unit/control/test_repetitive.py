"""Repetitive control: its law, and the predicted and measured convergence of its harmonics."""

import numpy as np
import pytest
from scipy.optimize import newton

import flexarm as fa

PERIOD, STEP = 0.5, 1e-3


class Waves:
    """A periodic reference of one joint with four harmonics."""

    def __init__(self, size=0.02, joints=1):
        self._omega = 2 * np.pi / PERIOD * np.arange(1, 5)
        self._size = size / np.arange(1, 5) ** 2
        self._joints = np.ones(joints)

    def _sum(self, t, order):
        phase = self._omega * t + order * np.pi / 2
        return np.sum(self._size * self._omega**order * np.sin(phase)) * self._joints

    def joint_angle(self, t):
        return self._sum(t, 0)

    def joint_rate(self, t):
        return self._sum(t, 1)

    def joint_acceleration(self, t):
        return self._sum(t, 2)


def one_link(flexible=True, payload=0.2):
    link = fa.Link(
        length=0.8,
        flexural_rigidity=800.0,
        mass_per_length=0.4,
        elements=1,
        damping=fa.ModalDamping(ratio=0.02),
    )
    joint = fa.Joint(hub_inertia=0.1, damping=0.3)
    arm = fa.Arm(links=[link], joints=[joint], payload=fa.Payload(mass=payload))
    return arm if flexible else arm.rigid()


class Kept(fa.RepetitiveControl):
    """A repetitive control that keeps its learned torques."""

    def reset(self):
        super().reset()
        self.learned = []

    def update(self, t, measurement, reference):
        total = super().update(t, measurement, reference)
        self.learned.append(total - self.inner.update(t, measurement, reference))
        return total


def control(kind=fa.RepetitiveControl, **changes):
    inner = changes.pop("inner", None) or fa.JointPD(300.0, 20.0, sample_time=STEP)
    given = {"period": PERIOD, "proportional": 150.0, "derivative": 10.0, "cutoff": 8.0}
    return kind(inner, **{**given, **changes})


def test_torque_is_that_of_its_law():
    """(C.107) with all sums written out, for random readings of two joints."""
    rng = np.random.default_rng(5)
    inner = fa.JointPD(0.0, 0.0, sample_time=0.01)
    gains = np.array([2.0, 1.0]), np.array([0.3, 0.0])
    made = fa.RepetitiveControl(inner, 0.5, *gains, cutoff=10.0, lead=0.02)
    made.reset()
    count, lead, half = 50, 2, 17
    weights = np.sinc(0.2 * np.arange(-half, half + 1)) * np.hamming(2 * half + 1)
    weights /= weights.sum()
    learned, errors = {}, {}
    for k in range(170):
        angle, rate = rng.normal(size=(2, 2))
        torque = made.update(0.01 * k, fa.Measurement(joint_angle=angle, joint_rate=rate), Still())
        sums = [
            q * (learned.get(k - count + j, 0.0) + errors.get(k - count + lead + j, 0.0))
            for j, q in zip(range(-half, half + 1), weights, strict=True)
        ]
        learned[k] = np.sum([one * np.ones(2) for one in sums], axis=0)
        errors[k] = -gains[0] * angle - gains[1] * rate
        np.testing.assert_allclose(torque, learned[k], atol=1e-12)
    assert abs(learned[169]).max() > 0.1


class Unknown(fa.Controller):
    """Controller without a step."""

    sample_time = STEP

    def update(self, t, measurement, reference):
        return np.zeros(1)


class Still:
    def joint_angle(self, t):
        return np.zeros(2)

    joint_rate = joint_acceleration = joint_angle


def test_harmonic_rates_of_a_rigid_link_are_those_of_transfer_functions():
    """Double integrator with damper, sampled by python-control, under PD feedback."""
    import control as ct

    arm = one_link(flexible=False)
    inertia = float(arm.mass_matrix(np.zeros(1))[0, 0])
    made = control(lead=0.005)
    plant = ct.c2d(ct.ss([[0, 1], [0, -0.3 / inertia]], [[0], [1 / inertia]], np.eye(2), 0), STEP)
    half = int(np.ceil(1.65 / 8.0 / STEP))
    j = np.arange(-half, half + 1)
    weights = np.sinc(16.0 * STEP * j) * np.hamming(j.size)
    count = round(PERIOD / STEP)

    def factor(z):
        angle, rate = plant(z)[:, 0]
        response = (150.0 * angle + 10.0 * rate) / (1.0 + 300.0 * angle + 20.0 * rate)
        return z**j @ weights / weights.sum() * (1.0 - z**5 * response)

    found = made.harmonic_rates(arm, [0.0])
    assert found.size == 251
    for harmonic in range(1, 6):
        # The pole z^count = factor(z) near the harmonic, by a general solver.
        start = np.exp(2j * np.pi * harmonic / count)
        pole = newton(lambda z: z**count - factor(z), start * (1.0 - 0.5 / count), tol=1e-14)
        assert abs(pole) ** count == pytest.approx(found[harmonic], rel=1e-6)
        assert abs(np.angle(pole / start)) < np.pi / count
    # Constant torques meet the compliance of the feedback: half of it is learned in a period. The
    # factor changes little between zero and the decay rate of this pole.
    assert found[0] == pytest.approx(0.5, rel=0.05)


@pytest.mark.thorough
def test_every_harmonic_decreases_at_its_predicted_rate():
    """The torque learned on a flexible link with a wrong payload, from period to period."""
    plant = one_link(payload=0.4)
    made = control(Kept, lead=0.01, cutoff=16.0)
    result = fa.simulate(plant, 10 * PERIOD, controller=made, reference=Waves())
    learned = np.array(made.learned)[:, 0].reshape(10, -1)
    changes = abs(np.fft.rfft(np.diff(learned, axis=0)))
    predicted = made.harmonic_rates(plant, [0.0])
    for harmonic in (3, 4):
        # Errors of the start, which are not periodic, leak into the harmonics: 3 % at the end.
        found = changes[-1, harmonic] / changes[-2, harmonic]
        assert found == pytest.approx(predicted[harmonic], rel=0.04)
    total = np.linalg.norm(np.diff(learned, axis=0), axis=1)
    assert result.attrs["repetitive_rate"] == pytest.approx(total[-1] / total[-2], rel=1e-12)


@pytest.mark.thorough
def test_measured_rate_becomes_the_largest_predicted_one():
    plant = one_link(payload=0.4)
    made = control()
    result = fa.simulate(plant, 12 * PERIOD, controller=made, reference=Waves())
    predicted = made.harmonic_rates(plant, [0.0]).max()
    assert result.attrs["repetitive_rate"] == pytest.approx(predicted, rel=0.01)
    assert 0.6 < predicted < 0.7


def test_rate_is_measured_from_the_third_period_on():
    """The torque of the first period is that of the filter's ends, not a learned one."""
    plant = one_link(payload=0.4)
    for periods, known in ((1.5, False), (2.5, False), (3.5, True)):
        made = control(Kept)
        result = fa.simulate(plant, periods * PERIOD, controller=made, reference=Waves())
        rate = result.attrs["repetitive_rate"]
        assert np.isfinite(rate) == known, periods
    learned = np.array(made.learned)[:, 0][: round(3 * PERIOD / STEP)].reshape(3, -1)
    changes = np.linalg.norm(np.diff(learned, axis=0), axis=1)
    assert rate == pytest.approx(changes[1] / changes[0], rel=1e-12)


@pytest.mark.thorough
def test_periodic_errors_vanish():
    plant = one_link(payload=0.4)
    made = control(lead=0.01, cutoff=16.0)
    errors = []
    for one in (made.inner, made):
        result = fa.simulate(plant, 12 * PERIOD, controller=one, reference=Waves())
        last = result.isel(time=slice(-501, None))
        wanted = np.array([Waves().joint_angle(t) for t in last.time.values])
        errors.append(np.sqrt(np.mean((last.joint_angle.values - wanted) ** 2)))
    assert errors[1] < 0.03 * errors[0]


def test_predicted_divergence_happens():
    """With three times the gain of the feedback, the torque overshoots by a factor of two."""
    plant = one_link()
    made = control(proportional=900.0, derivative=60.0)
    predicted = made.harmonic_rates(plant, [0.0]).max()
    assert 1.5 < predicted < 2.5
    result = fa.simulate(plant, 9 * PERIOD, controller=made, reference=Waves(1e-5))
    assert result.attrs["repetitive_rate"] > 1.4


def test_disturbance_with_the_period_vanishes_without_a_reference():
    plant = one_link()
    made = control(lead=0.02)
    push = fa.Load(1, moment=1.0, factor=lambda t: np.sin(2 * np.pi * t / PERIOD))
    result = fa.simulate(plant, 12 * PERIOD, controller=made, loads=[push])
    angle = result.joint_angle.values[:, 0]
    assert abs(angle[-501:]).max() < 0.05 * abs(angle[:501]).max()


def two_links():
    link = {"length": 0.5, "flexural_rigidity": 800.0, "mass_per_length": 0.4, "elements": 1}
    return fa.Arm(links=[fa.Link(**link)] * 2, joints=[fa.Joint(hub_inertia=0.1)] * 2)


def rates(changes, **given):
    return lambda: control(**changes).harmonic_rates(**{"posture": [0.0], **given})


READ = [fa.Instrument("joint_angle", sample_time=2 * STEP), fa.Instrument("joint_rate")]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (rates({}, plant="x"), "plant must be an Arm, got 'x'"),
        (rates({}, plant=None), "plant must be an Arm"),
        (rates({}, plant=one_link(), hardware="y"), "hardware must be a Hardware, got 'y'"),
        (
            rates({}, plant=one_link(), hardware=fa.Hardware(READ)),
            "has instruments with their own sample_time",
        ),
        (
            rates({"proportional": [1.0, 2.0, 3.0]}, plant=two_links(), posture=[0.0, 0.0]),
            r"3 joint\(s\), but the plant has 2",
        ),
        (
            rates({"inner": fa.JointPD([1.0] * 3, 1.0)}, plant=two_links(), posture=[0.0, 0.0]),
            r"3 joint\(s\), but the plant '1' has 2",
        ),
        (rates({}, plant=one_link(), posture=[0.0, 1.0]), "posture must be numbers of shape"),
        (rates({"inner": Unknown()}, plant=one_link()), "has no step"),
    ],
)
def test_wrong_arguments_of_the_prediction_are_rejected(call, text):
    with pytest.raises(fa.InputError, match=text):
        call()
