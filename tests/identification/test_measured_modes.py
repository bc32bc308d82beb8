"""Modes from records over time: a real robot arm, and systems that SciPy simulates."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.linalg import block_diag
from scipy.signal import lsim

import flexarm as fa

pytestmark = pytest.mark.compiled

ROBOT_ARM = Path(__file__).parents[2] / "examples" / "measured" / "robot_arm.csv"
RATE, COUNT = 100.0, 1500
#: Frequencies (Hz), damping ratios and residues (mode, output, input) of the simulated system.
HERTZ, DAMPING = np.array([3.1, 9.7]), np.array([0.004, 0.012])
RESIDUES = np.array([[[0.4 - 1.0j, 0.2 + 0.5j], [1.0j, 0.3]], [[0.7, 1.5j], [-0.6j, 0.5 - 0.5j]]])
OUTPUTS = ["joint_angle_1", "joint_angle_2"]


def simulated(seed, noise=0.0, start=(0.0, 0.0, 0.0, 0.0), count=COUNT):
    """Return a record of two modes under two random inputs, held between samples, by SciPy."""
    random = np.random.default_rng(seed)
    torque = random.standard_normal((count, 2))
    omega = 2 * np.pi * HERTZ
    A = block_diag(
        *(
            [[-d * w, w * np.sqrt(1 - d * d)], [-w * np.sqrt(1 - d * d), -d * w]]
            for d, w in zip(DAMPING, omega, strict=True)
        )
    )
    # x' = p x + u with x = a + i b for each input would need four states; two outputs share them
    # only if the residues have rank one, so that each input has its own system.
    outputs = np.zeros((count, 2))
    for k in range(2):
        B = np.array([[1.0], [0.0], [1.0], [0.0]])
        # 2 Re(A x) = 2 (Re A Re x - Im A Im x); Im x is minus the second state.
        C = np.stack(
            [np.ravel([[2 * r.real, 2 * r.imag] for r in RESIDUES[:, q, k]]) for q in range(2)]
        )
        first = start if k == 0 else np.zeros(4)
        times = np.arange(count) / RATE
        outputs += lsim((A, B, C, np.zeros((2, 1))), torque[:, k], times, first, interp=False)[1]
    outputs += noise * random.standard_normal(outputs.shape)
    data = xr.Dataset(
        {"torque": (("time", "joint"), torque), "joint_angle": (("time", "joint"), outputs)},
        {"time": np.arange(count) / RATE, "joint": [1, 2]},
    )
    return fa.MeasuredRecord(data, interpolation="hold")


def daisy(**settings):
    """The robot arm of KU Leuven, DaISY 96-009; its sample time is unknown, here 1 s."""
    channels = {"torque_1": "input", "joint_rate_1": "output"}
    return fa.read_record(ROBOT_ARM, channels, sample_time=1.0, **settings)


def test_a_real_robot_arm_is_reproduced():
    record = daisy()
    modes = fa.measured_modes(record, 3)
    two = fa.measured_modes(record, 2)
    # A fourth-order output-error model with free initial states, fitted by SciPy, reaches 92.7 %.
    assert two.fit[0] > 95.0
    np.testing.assert_allclose(two.frequency_hz, [0.0582, 0.1267], rtol=2e-3)
    # Both modes remain in higher orders; the third one is not a mode of the arm.
    assert modes.orders["stable"].sel(order=3).values[:2].all()
    # The record is one period of a sweep; the ends of its segments bias the rational fit.
    with pytest.warns(fa.AccuracyWarning, match="hardly reproduce"):
        rational = fa.frequency_response(record).modes(2)
    assert rational.fit[0, 0] < 50.0


def test_the_second_half_of_the_robot_arm_confirms_the_first():
    halves = [daisy(end=511.0), daisy(start=512.0)]
    first, second = (fa.measured_modes(half, 2) for half in halves)
    change = np.abs(second.frequency_hz - first.frequency_hz)
    both = np.hypot(first.frequency_deviation, second.frequency_deviation)
    assert np.all(change < 4.0 * both)


def test_lines_without_input_are_left_out_of_a_periodic_response():
    # The sweep of the robot arm has odd harmonics only; 96 to 98 % of the response are two modes.
    found = fa.frequency_response(daisy(), period=1024.0, band=(0.005, 0.19))
    lines = np.rint(1024.0 * found.frequency_hz)
    assert np.all(lines % 2 == 1)
    assert np.all(np.diff(lines) == 2)
    modes = found.modes(2)
    assert modes.fit[0, 0] > 97.0
    np.testing.assert_allclose(modes.frequency_hz, [0.05822, 0.12672], rtol=2e-4)
    # So does an odd multisine whose readings have 1 % of noise, in the torque, too.
    random, count, lines = np.random.default_rng(5), 4096, np.arange(41, 600, 2)
    torque, angle = np.zeros((2, count // 2 + 1), dtype=complex)
    torque[lines] = np.exp(2j * np.pi * random.uniform(size=lines.size))
    s = 2j * np.pi * np.arange(count // 2 + 1) * RATE / count
    for hertz, zeta, (residue,) in zip(HERTZ, DAMPING, RESIDUES[:, 0, :1], strict=True):
        pole = 2.0 * np.pi * hertz * (-zeta + 1j * np.sqrt(1.0 - zeta**2))
        angle += torque * (residue / (s - pole) + np.conj(residue) / (s - np.conj(pole)))
    signals = np.fft.irfft([torque, angle], n=count)
    signals += 0.01 * signals.std(axis=1, keepdims=True) * random.standard_normal(signals.shape)
    names, coordinates = ("torque", "joint_angle"), {"time": np.arange(count) / RATE, "joint": [1]}
    channels = zip(names, signals[:, :, None], strict=True)
    data = xr.Dataset({n: (("time", "joint"), v) for n, v in channels}, coordinates)
    record = fa.MeasuredRecord(data, interpolation="cubic")
    found = fa.frequency_response(record, period=count / RATE, band=(1.0, 14.63))
    np.testing.assert_allclose(found.frequency_hz, lines * RATE / count)
    np.testing.assert_allclose(found.modes(2).frequency_hz, HERTZ, rtol=1e-4)


def test_modes_and_residues_are_those_of_the_system():
    found = fa.measured_modes(simulated(1, start=(0.5, -0.3, 0.2, 0.1)), 2)
    np.testing.assert_allclose(found.frequency_hz, HERTZ, rtol=1e-8)
    np.testing.assert_allclose(found.damping_ratio, DAMPING, rtol=1e-6)
    np.testing.assert_allclose(found.residues, RESIDUES, rtol=1e-5, atol=1e-6)
    assert found.fit.min() > 99.999


def test_missing_samples_and_several_records():
    first, second = simulated(2, 0.02), simulated(3, 0.02, start=(1.0, 0.0, 0.0, 1.0), count=900)
    first.data["joint_angle"].values[300:420, 0] = np.nan
    found = fa.measured_modes([first, second], 2)
    errors = np.abs(found.frequency_hz - HERTZ) / found.frequency_deviation
    assert np.all(errors < 4.0)
    assert found.fitted.shape == (2400, 2)
    assert found.fit.min() > 96.0  # the noise is 2.8 % of an output
    # The fit goes on in the gap; its errors are smaller than the noise.
    gap = simulated(2).data["joint_angle"].values[300:420, 0]
    np.testing.assert_allclose(found.fitted[300:420, 0], gap, atol=0.02)


@pytest.mark.thorough
def test_deviations_are_those_of_many_records():
    found = [fa.measured_modes(simulated(seed, 0.04, count=600), 2) for seed in range(25)]
    errors = np.array([each.frequency_hz - HERTZ for each in found])
    stated = np.array([each.frequency_deviation for each in found])
    ratio = np.sqrt(np.mean(stated**2, axis=0) / np.mean(errors**2, axis=0))
    # 25 records determine the deviation of the errors to 14 %; the larger of two is stated.
    assert np.all((ratio > 0.8) & (ratio < 1.9)), ratio


def test_delays_of_the_readings_do_not_change_the_modes():
    record = simulated(4, count=600)
    data = record.data.copy(deep=True)
    data["joint_angle"][2:] = data["joint_angle"].values[:-2]
    data["joint_angle"][:2] = np.nan
    late = fa.MeasuredRecord(data, record.settings.replace(delays={"joint_angle": 2.0 / RATE}))
    found = fa.measured_modes(late, 2)
    np.testing.assert_allclose(found.frequency_hz, HERTZ, rtol=1e-4)
    np.testing.assert_allclose(found.residues, RESIDUES, rtol=0.02, atol=0.02)


@pytest.mark.parametrize(
    ("count", "band", "text"),
    [
        (2, (60.0, 70.0), "must overlap the frequencies of the records"),
        (200, None, "must contain at least .* samples for 200 modes"),
        (2, (3.0, 1.0), "band must be ascending"),
    ],
)
def test_wrong_arguments(count, band, text):
    with pytest.raises(fa.InputError, match=text):
        fa.measured_modes(simulated(1, count=400), count, band=band)
