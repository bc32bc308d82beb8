"""The scenario files in ``examples/`` run, and their results are physically right."""

from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import brentq

import flexarm as fa
from flexarm.cases.scenario.scenario import prepare
from flexarm.model import load_scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
GRAVITY = 9.81


def prepared(name):
    return prepare(load_scenario(EXAMPLES / f"{name}.yaml"))


def test_every_file_is_tested_here():
    names = {path.stem for path in EXAMPLES.glob("*.yaml")}
    assert names == {"paper", "single_link", "boom", "ten_link_chain", "wipe_wall"}


def test_every_file_describes_its_result():
    for path in EXAMPLES.glob("*.yaml"):
        text = path.read_text(encoding="utf-8")
        assert text.startswith("# "), path
        assert len(text.split("flexarm: 1")[0].splitlines()) >= 5, path


def test_paper_file_is_the_packaged_case():
    packaged = (files("flexarm") / "library" / "paper.yaml").read_text(encoding="utf-8")
    assert (EXAMPLES / "paper.yaml").read_text(encoding="utf-8") == packaged


@pytest.fixture(scope="module")
def single_link():
    scenario = prepared("single_link")
    return scenario.arm, scenario.run()


def test_single_link_reaches_its_goal(single_link):
    _, result = single_link
    assert result["tip"].values[-1] == pytest.approx([0.0, 1.0], abs=1e-3)


def root_strain(result):
    """Return the strain at the root from the torque alone, (T,): moment = torque less that of the
    hub."""
    rigidity = 70e9 * 0.04 * 0.004**3 / 12.0
    rate = result["joint_rate"].values[:, 0]
    hub = 0.02 * np.gradient(rate, result["time"].values) + 0.01 * rate
    # A positive moment at the root makes the tip lag, and strains the side of +y.
    return 0.002 * (result["torque"].values[:, 0] - hub) / rigidity


def test_single_link_lag_and_strain_follow_from_the_torque(single_link):
    _, result = single_link
    deflection = result["link_tip_deflection"].values[:, 0]
    assert np.max(np.abs(deflection)) == pytest.approx(0.074, rel=0.01)  # stated in the file
    strain = result["strain"].values[:, 0]
    moving = slice(100, 900)  # without the jumps of jerk at both ends, which excite omitted modes
    # 1 % of the largest value, because four modes approximate the load along the strip
    largest = np.max(np.abs(strain))
    assert np.allclose(strain[moving], root_strain(result)[moving], rtol=0.0, atol=0.01 * largest)


def test_linear_theory_of_the_single_link_lacks_the_centrifugal_force():
    scenario = prepared("single_link")
    result = scenario.run(arm=fa.Arm(scenario.arm.spec.replace(theory="linear")))
    strain = result["strain"].values[:, 0]
    error = np.max(np.abs(strain - root_strain(result))[100:900]) / np.max(np.abs(strain))
    assert 0.03 < error < 0.04  # stated in the file


def test_single_link_vibrates_at_the_exact_frequency(single_link):
    arm, _ = single_link
    ratio = 0.15 / 0.432

    def frequency_equation(b):
        sines = np.sin(b) * np.cosh(b) - np.cos(b) * np.sinh(b)
        return 1.0 + np.cos(b) * np.cosh(b) - ratio * b * sines

    b = brentq(frequency_equation, 0.5, 2.0)
    rigidity, density = 70e9 * 0.04 * 0.004**3 / 12.0, 2700.0 * 0.04 * 0.004
    exact = b**2 * np.sqrt(rigidity / density) / (2.0 * np.pi)
    # 0.1 %, because the equation omits the inertia of the payload and of the sections
    assert fa.modes(arm).frequency_hz[0] == pytest.approx(exact, rel=1e-3)


@pytest.fixture(scope="module")
def boom():
    scenario = prepared("boom")
    return scenario, scenario.run()


def test_boom_stays_in_equilibrium_until_its_motion_starts(boom):
    scenario, result = boom
    before = result.sel(time=slice(0.0, 1.0))
    # The residual forces of the equilibrium, where 1e4 N cancel, are rounding.
    assert np.ptp(before["tip"].values, axis=0) == pytest.approx(np.zeros(2), abs=1e-8)
    rigid = scenario.arm.rigid()
    straight = rigid.tip(rigid.rest(before["joint_angle"].values[0]))
    below = straight[1] - before["tip"].values[0, 1]
    assert below == pytest.approx(0.141, abs=5e-4)  # stated in the file


def test_boom_rests_at_its_new_angles(boom):
    scenario, result = boom
    assert result["joint_rate"].values[-1] == pytest.approx(np.zeros(3), abs=1e-3)
    assert result["joint_angle"].values[-1] == pytest.approx([1.30, -0.70, -0.50], abs=5e-3)
    rigid_tip = scenario.arm.rigid().tip(scenario.arm.rigid().rest([1.30, -0.70, -0.50]))
    assert 0.05 < rigid_tip[1] - result["tip"].values[-1, 1] < 0.5  # m: the tip is lower


def test_boom_sag_agrees_with_the_textbook(boom):
    _, result = boom
    outer, inner = 0.14, 0.13
    rigidity = 210e9 * np.pi * (outer**4 - inner**4) / 64.0
    weight = 7850.0 * np.pi * (outer**2 - inner**2) / 4.0 * GRAVITY
    across = np.cos(result["link_angle"].values[-1, 2])
    load = 120.0 * GRAVITY * across
    sag = load * 3.0**3 / (3.0 * rigidity) + weight * across * 3.0**4 / (8.0 * rigidity)
    # a thousandth, for the remaining vibration
    assert result["link_tip_deflection"].values[-1, 2] == pytest.approx(-sag, rel=1e-3)


def test_boom_motors_hold_its_weight(boom):
    scenario, result = boom
    arm = scenario.arm
    points = arm.shape(result["q"].values[-1], 401)[:, :, 0]
    masses = [link.beam().mass_per_length[0] * link.length for link in arm.spec.links]
    moment = sum(m * np.trapezoid(x, dx=1 / 400) for m, x in zip(masses, points, strict=True))
    moment += 25.0 * points[0, -1] + 15.0 * points[1, -1] + 120.0 * points[2, -1]
    assert result["torque"].values[-1, 0] == pytest.approx(GRAVITY * moment, rel=1e-3)


def test_chain_conserves_energy():
    result = prepared("ten_link_chain").run()
    energy = sum(result[f"{kind}_energy"].values for kind in ("kinetic", "strain", "gravity"))
    moved = np.max(result["kinetic_energy"].values)
    # 12000 steps with a relative error of 1e-7 at most each; 1e-11 was measured.
    assert np.max(np.abs(energy - energy[0])) < 1e-8 * moved
    # The 0.94 kg have fallen by nearly a metre.
    assert moved == pytest.approx(0.94 * GRAVITY * 1.0, rel=0.05)
    assert np.max(np.hypot(*result["tip"].values.T)) < 2.0 * (1 + 1e-3)


def test_wiping_a_wall():
    """The tip makes contact, slides along the wall with Coulomb friction, and stays in contact."""
    result = prepared("wipe_wall").run()
    gap = result["contact_gap"].values[:, 0]
    force = result["contact_force"].values[:, 0]
    on = result["time"].values > 1.6
    assert np.all(gap[:10] > 0.0)
    assert np.all(gap[on] < 0.0)
    sliding = on & (result["tip_velocity"].values[:, 1] > 0.02)
    assert sliding.sum() > 20
    np.testing.assert_allclose(force[sliding, 1], 0.25 * force[sliding, 0], rtol=2e-3)
