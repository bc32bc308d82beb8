"""``flexarm design``: tables, reasons and a scenario that runs."""

import pytest
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.main import app
from flexarm.planning.proposals.candidates import Loops

ARM = """\
flexarm: 1
arm:
  links:
    - length: 0.8
      flexural_rigidity: 20.0
      mass_per_length: 0.5
      elements: 1
      damping: {kind: modal, ratio: 0.01}
      gauges: [{station: 0.02, distance: 0.004}]
  joints: [{hub_inertia: 0.05}]
  payload: {mass: 0.1}
"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(ARM)
    return path


def call(*arguments):
    return CliRunner().invoke(app, ["design", *map(str, arguments)])


@pytest.mark.thorough
def test_the_written_scenario_runs(path, tmp_path):
    out = tmp_path / "design.yaml"
    options = ("--task", "hold", "--computing", "low", "--start", "0.3")
    outcome = call(path, *options, "--out", out)
    assert outcome.exit_code == 0, outcome.output
    for text in ("Task hold: error in mm", "integral resonant", "joint PD", "disk margin"):
        assert text in " ".join(outcome.output.split())
    assert outcome.output.splitlines()[-1] == f"scenario in {out}"
    scenario = fa.load_scenario(out)
    assert scenario.motion.start == (0.3,)
    assert fa.run_scenario(out, progress=False).sizes["time"] > 1


@pytest.mark.thorough
def test_the_hardware_of_a_file_is_that_of_the_scenario(path, tmp_path):
    hardware, out = tmp_path / "drive.yaml", tmp_path / "design.yaml"
    encoder = "{signal: joint_angle, resolution: 1e-4, rate_cutoff: 80}"
    text = f"flexarm: 1\nhardware:\n  instruments: [{encoder}]\n  motors: {{delay: 0.002}}\n"
    hardware.write_text(text)
    options = ("--task", "hold", "--computing", "low", "--out", out)
    outcome = call(path, *options, "--hardware", hardware)
    assert outcome.exit_code == 0, outcome.output
    assert "A typical drive is assumed" not in " ".join(outcome.output.split())
    scenario = fa.load_scenario(out)
    assert scenario.hardware.motors.delay == 0.002
    assert [item.rate_cutoff for item in scenario.hardware.instruments] == [80.0]


def test_a_file_without_hardware_is_refused(path, tmp_path):
    outcome = call(path, "--task", "hold", "--hardware", path, "--out", tmp_path / "design.yaml")
    assert outcome.exit_code == 2
    assert "hardware is missing" in " ".join(outcome.output.split())
    other = tmp_path / "drive.yaml"
    other.write_text("flexarm: 1\nhardware: {motors: {dely: 0.002}}\n")
    outcome = call(path, "--task", "hold", "--hardware", other, "--out", tmp_path / "design.yaml")
    assert "hardware.motors.dely is not a known key" in " ".join(outcome.output.split())
    assert "drive.yaml:2" in "".join(outcome.output.split())


@pytest.mark.thorough
def test_an_existing_file_is_replaced_on_request_only(path, tmp_path):
    out = tmp_path / "mine.yaml"
    out.write_text("mine")
    options = (path, "--task", "hold", "--computing", "low", "--sensors", "joints", "--out", out)
    refused = call(*options)
    assert refused.exit_code == 2
    assert "already exists" in refused.output
    assert "--overwrite" in refused.output
    assert out.read_text() == "mine"
    assert call(*options, "--overwrite").exit_code == 0
    assert fa.load_scenario(out).drive.kind == "joint_pd"


@pytest.mark.thorough
def test_an_unstable_proposal_fails_and_is_not_written(path, tmp_path, monkeypatch):
    assess = Loops.assess

    def unstable(self, drive):
        one, _ = assess(self, drive)
        return one._replace(margins={**one.margins, "growth": 1.0, "disk_margin": 0.0}), []

    monkeypatch.setattr(Loops, "assess", unstable)
    out = tmp_path / "design.yaml"
    options = ("--task", "hold", "--computing", "low", "--sensors", "joints", "--out", out)
    outcome = call(path, *options)
    assert outcome.exit_code == 1
    assert "Task hold: error in mm" in outcome.output
    assert "* is the best one, which is refused" in " ".join(outcome.output.split())
    assert "No candidate is stable on the model" in outcome.output
    assert "no candidate is accepted, so no scenario is written" in outcome.output
    assert not out.exists()


def test_one_torque_limit_is_that_of_all_joints(path, tmp_path):
    link = ARM.partition("links:\n")[2].partition("  joints:")[0]
    two = ARM.replace(link, 2 * link).replace("{hub_inertia: 0.05}", "{hub_inertia: 0.05}, {}")
    path.write_text(two)
    options = ("--task", "hold", "--out", tmp_path / "design.yaml", "--disk-margin", "5")
    for limit in ("5", "5,4"):  # the next wrong option is reported
        found = call(path, *options, "--torque-limit", limit).output
        assert "disk_margin must be greater than 0" in found
    found = call(path, *options, "--torque-limit", "0").output
    assert "torque_limit must be greater than 0, got 0" in found


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--start", "0.3,x"), "--start must be numbers separated by commas"),
        (("--sensors", "joints,eyes"), "sensors must be one of"),
        (("--torque-limit", "0"), "torque_limit must be greater than 0"),
        (("--torque-limit", "1,2,3"), "torque_limit must be"),
        (("--out", "design.txt"), "--out must end in .yaml or .yml"),
    ],
)
def test_wrong_options_are_named_and_nothing_is_written(
    path, tmp_path, monkeypatch, options, message
):
    monkeypatch.chdir(tmp_path)
    outcome = call(path, "--task", "hold", *options)
    assert outcome.exit_code == 2
    assert message in outcome.output
    assert [item.name for item in tmp_path.iterdir()] == ["arm.yaml"]
