"""The page of measured arms: numbers of its text, and its calls on files of the same layout."""

import re
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from docs_pages import ROOT, text_of
from scipy.optimize import minimize

import flexarm as fa

PAGE = text_of("docs/how-to/measured-arms.md")
RECORD = ROOT / "examples" / "measured" / "robot_arm.csv"
CALLS = re.findall(r"`(fa\.read_record\(.*?\))` \|$", PAGE, re.MULTILINE)
COLUMNS = {"torque_1": "input", "joint_acceleration_1": "output"}


def record(channels=COLUMNS, **options):
    return fa.read_record(RECORD, channels, sample_time=0.01, **options)


def unseen_half(modes):
    measured = record().data["joint_acceleration"].values[512:, 0]
    error = np.linalg.norm(measured - modes.fitted[512:, 0])
    return 100.0 * (1.0 - error / np.linalg.norm(measured - measured.mean()))


@pytest.mark.thorough
@pytest.mark.compiled
def test_two_modes_have_residues_of_opposite_sign_and_a_third_is_none():
    half = record(masks={"joint_acceleration_1": [(5.12, 10.23)]})
    two, three = fa.measured_modes(half, 2), fa.measured_modes(half, 3)
    assert f"unseen half: {unseen_half(two):.1f} %" in PAGE
    assert f"the unseen half to {unseen_half(three):.1f} %, but at " in PAGE
    assert f"at {three.frequency_hz[2]:.0f} Hz, above half the rate" in PAGE
    first, second = two.residues[:, 0, 0].imag
    assert first * second < 0.0
    ratio = two.frequency_hz[1] / two.frequency_hz[0]
    assert f"the second frequency is {ratio:.2f} times the first" in PAGE


@pytest.mark.thorough
@pytest.mark.compiled
def test_the_acceleration_is_rather_the_output():
    fit = fa.measured_modes(record(), 2).fit[0]
    swapped = {"torque_1": "output", "joint_acceleration_1": "input"}
    other = fa.measured_modes(record(swapped), 2).fit[0]
    assert f"reproduce {other:.0f} % of the output instead of {fit:.1f} %" in PAGE


def test_the_joint_is_free_and_a_peak_lies_above_the_sweep():
    data = record().data
    names = ("torque", "joint_acceleration")
    torque, acceleration = (np.fft.rfft(data[name].values[:, 0]) for name in names)
    slow = (acceleration / torque)[1:12:2]
    assert np.ptp(slow.real) < 0.1 * abs(slow.real.mean())
    assert np.all(np.abs(slow.imag) < 0.1 * np.abs(slow.real))
    peak = 300 + np.argmax(np.abs(acceleration[300:]))
    assert f"a narrow peak at {peak / 10.24:.1f} Hz" in PAGE
    assert abs(torque[peak]) < 2.0 * np.median(np.abs(torque[300:400]))


@pytest.mark.thorough
@pytest.mark.compiled
def test_hub_link_and_point_mass_cannot_have_the_frequencies():
    def ratio(numbers):
        hub, mass = np.exp(numbers)
        link = fa.Link(length=1.0, flexural_rigidity=700.0, mass_per_length=10.0, elements=6)
        payload = fa.Payload(mass=10.0 * mass)
        arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=10.0 * hub)], payload=payload)
        hertz = fa.modes(arm, joints="free").frequency_hz
        return hertz[2] / hertz[1]

    options = {"maxiter": 60, "xatol": 1e-2, "fatol": 1e-4}
    starts = [(-4.0, -4.0), (-3.0, 3.0)]
    least = min(minimize(ratio, s, method="Nelder-Mead", options=options).fun for s in starts)
    assert f"theirs is at least {least:.2f}" in PAGE


def written(folder: Path) -> None:
    """Write small files with the layouts of other records: names, columns, separators."""
    times = 0.002 * np.arange(200)
    counts = np.rint(50.0 * np.sin(9.0 * times[:, None] - np.arange(4)))
    rows = (
        "\t".join(f"{value:g}" for value in (time, number, *count))
        for number, (time, count) in enumerate(zip(times, counts, strict=True))
    )
    header = "#SLFR RTP OL_Test\n#t\tn\tu\tv\t$\\theta$\ta\n"
    (folder / "swept2-0-10hz.txt").write_text(header + "\n".join(rows) + "\n")
    wave = np.sin(9.0 * times)[:, None]
    link = {"U": wave, "Theta": 0.5 * wave, "Alpha": 0.1 * wave}
    scipy.io.savemat(folder / "LinkShield_ID_Data.mat", link)
    states = {"time": times[:, None], "X1_meas": wave * [0.2, 0.1, 2.0, 1.0], "ref_deg": 10.0}
    scipy.io.savemat(folder / "lqr_step_10deg_run01.mat", states)


@pytest.mark.parametrize("call", CALLS)
def test_calls_read_files_of_the_same_layout(call, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    written(tmp_path)
    found = eval(call, {"fa": fa})  # of the page
    assert found.data.sizes["time"] == 200
    assert len(found.outputs) >= 1
    for channel in found.data.data_vars:
        assert np.ptp(found.data[channel].values) > 0.0


def test_the_page_has_three_calls():
    assert len(CALLS) == 3
