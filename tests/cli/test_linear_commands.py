"""``flexarm modes`` along motions and spins, ``flexarm linearize``: tables, files, plots and
errors."""

import csv
import json
from types import SimpleNamespace

import numpy as np
import pytest
from scenarios import invoke
from scipy.io import loadmat

import flexarm as fa
from flexarm.cli.commands.linearize import _poles

ARM = """\
flexarm: 1
arm:
  theory: second_order
  links:
    - {length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.6, elements: 2,
       damping: {kind: modal, ratio: 0.01}}
    - {length: 0.8, flexural_rigidity: 105.0, mass_per_length: 0.6, elements: 1}
"""
HEAVY = ARM + "  gravity: [0, -9.81]\n"


@pytest.fixture
def path(tmp_path):
    file = tmp_path / "arm.yaml"
    file.write_text(ARM)
    return file


@pytest.fixture
def heavy(tmp_path):
    file = tmp_path / "heavy.yaml"
    file.write_text(HEAVY)
    return file


def frequencies(outcome):
    """Return the first column of numbers of the table, Hz."""
    assert outcome.exit_code == 0, outcome.output
    rows = [line.split() for line in outcome.stdout.splitlines() if line.strip()[:1].isdigit()]
    return [float(row[1]) for row in rows]


def read(table):
    with open(table, newline="") as stream:
        head, *rows = csv.reader(stream)
    return head, np.array(rows, dtype=float)


def test_modes_with_joint_gains(path):
    gains = ["--proportional", "40,10", "--derivative", "2,1", "--angles", "0.3,1", "--count", 3]
    expected = fa.modes(fa.load_arm(path), [0.3, 1.0], [(40.0, 2.0), (10.0, 1.0)])
    found = frequencies(invoke("modes", path, *gains))
    np.testing.assert_allclose(found, expected.frequency_hz[:3], rtol=1e-5)


def test_modes_about_the_sagging_equilibrium(heavy):
    arm = fa.load_arm(heavy)
    expected = fa.modes(arm, fa.equilibrium(arm)).frequency_hz[:6]
    found = frequencies(invoke("modes", heavy, "--sag"))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_modes_at_a_spin_rate(path):
    expected = fa.modes(fa.load_arm(path), spin=10.0).frequency_hz[:6]
    found = frequencies(invoke("modes", path, "--spin", 10))
    np.testing.assert_allclose(found, expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("arm", "options", "cause"),
    [
        ("gravity: [0, -9.81]", ("--angles", "1.5708,0"), "gravity"),
        ("gravity: [0, 0]", ("--angles", "0,3.1416", "--spin", 10), "the spin"),
    ],
)
def test_cause_of_an_instability_is_reported(arm, options, cause, tmp_path):
    """An upright link on weak springs, and a second link that is folded back to the axis of
    rotation."""
    file = tmp_path / "weak.yaml"
    link = "{length: %g, mass_per_length: 1, flexible: false}"
    file.write_text(f"flexarm: 1\narm:\n  links: [{link % 1.0}, {link % 0.3}]\n  {arm}\n")
    gains = ("--proportional", "0.01,0.01", "--derivative", "0,0")
    outcome = invoke("modes", file, *gains, *options)
    assert f"unstable: {cause} pulls the arm away from this posture" in outcome.output


@pytest.mark.thorough
def test_modes_are_tracked_to_a_posture(path, tmp_path):
    table, plot = tmp_path / "way.csv", tmp_path / "way.png"
    outcome = invoke("modes", path, "--to", "0,2", "--count", 3, "--csv", table, "--plot", plot)
    assert "way" in outcome.stdout
    head, rows = read(table)
    assert head[0] == "posture"
    assert rows.shape == (81, 7)
    last = fa.modes(fa.load_arm(path), [0.0, 2.0]).frequency_hz[:3]
    np.testing.assert_allclose(np.sort(rows[-1, 1:4]), last, rtol=1e-9)
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.thorough
def test_campbell_diagram_is_written(path, tmp_path):
    table, plot = tmp_path / "spin.csv", tmp_path / "spin.pdf"
    invoke("modes", path, "--campbell", 20, "--count", 2, "--csv", table, "--plot", plot)
    head, rows = read(table)
    assert head[0] == "spin [rad/s]"
    assert np.all(np.diff(rows[:, 1]) > 0.0)
    assert plot.read_bytes().startswith(b"%PDF")


def test_mode_shapes_are_plotted(path, tmp_path):
    plot = tmp_path / "shapes.svg"
    assert "shapes in" in invoke("modes", path, "--plot", plot).stdout
    assert "<svg" in plot.read_text()


def test_linearize_writes_and_prints_the_model(heavy, tmp_path):
    out, plot = tmp_path / "arm.mat", tmp_path / "response.png"
    signals = ["--inputs", "torque,tip_force", "--outputs", "tip, joint_rate"]
    outcome = invoke(
        "linearize", heavy, "--angles", "0.3,1", *signals, "--out", out, "--plot", plot
    )
    assert outcome.exit_code == 0, outcome.output
    assert "torque[1], torque[2], tip_force[x], tip_force[y]" in outcome.stdout
    arm = fa.load_arm(heavy)
    model = fa.linearize(
        arm,
        fa.equilibrium(arm, [0.3, 1.0]),
        inputs=["torque", "tip_force"],
        outputs=["tip", "joint_rate"],
    )
    np.testing.assert_array_equal(loadmat(out)["A"], model.A)
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_poles_of_an_arm_with_free_joints(path, tmp_path):
    outcome = invoke("linearize", path, "--count", 6, "--out", tmp_path / "arm.json")
    rows = [line.split() for line in outcome.stdout.splitlines()]
    assert sum(row == ["0", "0", "0", "-"] for row in rows) == 4  # two rigid modes, twice each
    assert json.loads((tmp_path / "arm.json").read_text())["inputs"] == ["torque[1]", "torque[2]"]


def test_rounding_of_poles_is_shown_as_zero():
    """Compared with the fastest pole: 1e-5 is rounding beside 1e6 rad/s, and a pole beside 1."""
    for fastest, shown in ((1e6, "0"), (1.0, "-1e-05")):
        model = SimpleNamespace(poles=np.array([-1e-5, 1j * fastest, -1j * fastest]))
        assert [row[0] for row in _poles(model)] == [shown, "0"]


CLAMPED = """\
flexarm: 1
arm:
  links: [{length: 1.0, flexural_rigidity: 105.0, mass_per_length: 0.6, elements: 2}]
  joints: [{fixed: true}]
"""


@pytest.mark.sampled("joints0")
@pytest.mark.parametrize("joints", [[], ["--joints", "free"], ["--joints", "locked"]])
def test_arm_with_fixed_joints_only(joints, tmp_path):
    file = tmp_path / "clamped.yaml"
    file.write_text(CLAMPED)
    outcome = invoke("modes", file, *joints)
    assert outcome.stdout.splitlines()[0].rstrip() == "Modes, no joint turns"
    expected = fa.modes(fa.load_arm(file)).frequency_hz
    np.testing.assert_allclose(frequencies(outcome), expected, rtol=1e-5)
    shown = invoke("linearize", file, "--inputs", "tip_force", "--count", 1).stdout
    assert "at rest  no joint turns" in shown
    wrong = invoke("modes", file, "--angles", "1")
    assert wrong.exit_code == 2
    assert "--angles is not supported for an arm whose joints are all fixed" in wrong.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["modes", "--to", "1"], "--to must be 2 numbers"),
        (["modes", "--proportional", "1"], "--proportional must be 2 numbers"),
        (["modes", "--joints", "free", "--derivative", "1,1"], "--joints cannot be combined with"),
        (["modes", "--sag", "--spin", "1"], "--sag is not supported with a rotating arm"),
        (["modes", "--to", "1,1", "--spin", "1"], "--to is not supported with a rotating arm"),
        (["modes", "--spin", "2", "--campbell", "1"], "--campbell must be greater than --spin"),
        (["modes", "--plot", "a.mat"], "--plot must end in"),
        (["linearize", "--inputs", "torqe"], "inputs must be a Load or one of"),
        (["linearize", "--out", "a.csv"], "--out must end in .mat or .json"),
        (["linearize", "--angles", "x"], "--angles must be 2 numbers"),
    ],
)
def test_wrong_input_is_rejected(arguments, message, path):
    command, *options = arguments
    outcome = invoke(command, path, *options)
    assert outcome.exit_code == 2
    assert message in outcome.stderr
