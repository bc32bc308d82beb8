"""``flexarm init``, and the options of ``flexarm run`` that change a run without editing."""

import json
import shlex

import numpy as np
import pytest
from scenarios import GOOD, invoke

import flexarm as fa
from flexarm.cases.templates import MOST_LINKS
from flexarm.simulation.calls.metrics import length_text


@pytest.mark.sampled("1-vertical-slender", "2-horizontal-slender", "2-vertical-stiff")
@pytest.mark.parametrize("stiff", [[], ["--stiff"]], ids=["slender", "stiff"])
@pytest.mark.parametrize("gravity", [[], ["--gravity"]], ids=["horizontal", "vertical"])
@pytest.mark.parametrize("links", [1, 2, 3, MOST_LINKS])
def test_files_of_init_pass_the_check_without_a_warning(tmp_path, links, gravity, stiff):
    folder = tmp_path / "new" / "arm"
    outcome = invoke("init", folder, "--links", links, *gravity, *stiff)
    assert outcome.exit_code == 0
    assert sorted(path.name for path in folder.iterdir()) == ["arm.yaml", "scenario.yaml"]
    for name in ("arm.yaml", "scenario.yaml"):
        checked = invoke("check", folder / name)
        assert (checked.exit_code, checked.stderr) == (0, "")
        assert checked.stdout.endswith("ok\n")
    arm = fa.load_arm(folder / "arm.yaml")
    assert arm.n_links == links
    assert np.sum(arm.lengths) == pytest.approx(2.0, abs=1e-3)
    assert arm.spec.gravity == (0.0, -9.81 if gravity else 0.0)
    # The written sample time is within the recommended one.
    words = " ".join(checked.stdout.split()).partition("sample time ")[2].split()
    assert float(words[words.index("has") + 1]) <= float(words[0])


def _run_of_init(folder, *options):
    """Return the result of the files of init, which must run without a warning."""
    assert invoke("init", folder, *options).exit_code == 0
    outcome = invoke("run", folder / "scenario.yaml", "--out", folder / "run.nc", "--quiet")
    assert (outcome.exit_code, outcome.stdout, outcome.stderr) == (0, "", "")
    return fa.read_result(folder / "run.nc")


@pytest.mark.thorough
@pytest.mark.parametrize("gravity", [[], ["--gravity"]], ids=["horizontal", "vertical"])
def test_arms_of_init_ring_visibly_and_stiff_ones_reach_their_goal(tmp_path, gravity):
    ringing = {}
    for name, options in (("slender", gravity), ("stiff", [*gravity, "--stiff"])):
        result = _run_of_init(tmp_path / name, *options)
        duration = fa.load_scenario(tmp_path / name / "scenario.yaml").motion.duration
        after = result.link_tip_deflection.sel(link=1, time=slice(duration, duration + 1.0))
        ringing[name] = float(after.max() - after.min()) / 2.0
        # The vibration of the slender arm decays slowly; with gravity, its links also sag.
        missed = np.hypot(*(result.tip.values[-1] - [0.7, 1.2]))
        assert missed < {"slender": 0.05, "stiff": 1e-3}[name]
    # One percent of a link of 1 m; the stiff arm rings by at most 0.3 mm.
    assert ringing["slender"] > 0.01
    assert ringing["stiff"] < 0.1 * ringing["slender"]


@pytest.mark.parametrize("name", ["arm", "my arm"])
def test_commands_that_init_prints_are_commands(tmp_path, name):
    lines = invoke("init", tmp_path / name).stdout.partition("next: ")[2].splitlines()
    check, run = (shlex.split(line) for line in lines)
    folder = tmp_path / name
    assert check == ["flexarm", "check", str(folder / "scenario.yaml")]
    assert run[2:] == [str(folder / "scenario.yaml"), "--animate", str(folder / "arm.html")]
    assert ('"' in "".join(lines)) == (" " in name)
    assert invoke(*check[1:]).exit_code == 0


def test_init_does_not_overwrite_files(tmp_path):
    (tmp_path / "scenario.yaml").write_text("mine")
    outcome = invoke("init", tmp_path)
    assert outcome.exit_code == 2
    assert "scenario.yaml' already exists." in outcome.stderr
    assert (tmp_path / "scenario.yaml").read_text() == "mine"
    assert not (tmp_path / "arm.yaml").exists()


def test_init_rejects_a_path_that_is_a_file(good):
    outcome = invoke("init", good)
    assert outcome.exit_code == 2
    assert "must be a writable folder" in outcome.stderr


def test_set_equals_a_change_of_the_file(good, tmp_path):
    options = ["--set", "arm.links[1].length=0.6", "--set", "run={duration: 0.02, rate: 500}"]
    out = tmp_path / "set.nc"
    assert invoke("run", good, *options, "--out", out, "--quiet").stdout == ""
    edited = tmp_path / "edited.yaml"
    assert GOOD.count("length: 0.5") == 1
    text = GOOD.replace("length: 0.5", "length: 0.6")
    edited.write_text(text.partition("run:")[0] + "run: {duration: 0.02, rate: 500}\n")
    wanted = fa.run_scenario(edited)
    found = fa.read_result(out)
    np.testing.assert_array_equal(found["tip"], wanted["tip"])
    assert found.attrs["scenario"] == wanted.attrs["scenario"]


def test_later_set_overrides_and_missing_keys_are_added(good):
    options = ["--set", "initial.joint_angle=[0.1, 0.2]", "--set", "run.rate=50"]
    options += ["--set", "motion=", "--set", "drive={kind: none}", "--set", "run.rate=100"]
    reported = json.loads(invoke("run", good, *options, "--duration", "0.05", "--json").stdout)
    assert reported["samples"] == 6
    assert reported["changes"][-1] == "--duration 0.05"
    np.testing.assert_allclose(reported["joint_angle"], [0.1, 0.2], rtol=0, atol=1e-9)


def test_accuracy_is_requested_and_its_error_printed(good, tmp_path):
    out = tmp_path / "run.nc"
    outcome = invoke("run", good, "--accuracy", "1e-4", "--out", out)
    assert outcome.exit_code == 0
    assert "m of the integration" in outcome.stdout
    assert 0.0 < fa.read_result(out).attrs["integration_error"] <= 1e-4
    refused = invoke("run", good, "--accuracy", "1e-4", "--set", "run.rtol=1e-6")
    assert refused.exit_code == 2
    assert "run.accuracy cannot be combined with rtol" in refused.stderr


def test_set_changes_an_arm_in_a_separate_file(tmp_path):
    assert invoke("init", tmp_path).exit_code == 0
    scenario = tmp_path / "scenario.yaml"
    options = ["--duration", "0.01", "--json"]
    one = json.loads(invoke("run", scenario, *options).stdout)
    # Links 1 and 2 of the file share their values by an alias, and only one of them changes.
    changed = invoke("run", scenario, *options, "--set", "arm.links[1].length=0.9")
    assert changed.exit_code == 0
    np.testing.assert_allclose(json.loads(changed.stdout)["tip"], one["tip"], rtol=0, atol=2e-2)
    refused = invoke("run", scenario, "--set", "arm.links[1].length=-1")
    assert refused.exit_code == 2
    (line,) = refused.stderr.splitlines()
    reported = "arm.links[1].length must be greater than 0, got -1."
    assert line == f"--set arm.links[1].length=-1: {reported}"
    other = tmp_path / "other.yaml"
    other.write_text((tmp_path / "arm.yaml").read_text().replace("length: 1.0", "length: 0.2"))
    refused = invoke("run", scenario, "--set", "arm=other.yaml")
    assert refused.exit_code == 2
    assert "motion.start must lie within the reach of 0.4 m" in refused.stderr


def test_integrator_of_the_command_line_replaces_that_of_the_file(good):
    reported = json.loads(invoke("run", good, "--integrator", "rk4", "--json").stdout)
    assert reported["integrator"] == "rk4"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--set", "run.durtion=1"], "run.durtion is not a known key. Did you me"),
        (["--set", "arm.links[7].length=1"], "arm.links[7] does not exist: the list has 2 entries"),
        (["--set", "run[0]=1"], "run must be a list, got "),
        (["--set", "run.rate.x=1"], "run.rate must be a mapping of keys to values, got "),
        (["--set", "arm.links=[1,"], "arm.links is not valid YAML"),
        (["--set", "arm.links"], "--set must be a key path and a value, such as run.duration=3"),
        (["--set", "arm..links=1"], "--set must be a key path and a value"),
        (["--duration", "-1"], "--duration -1: run.duration must be greater than 0, got -1."),
        (["--duration", "long"], "--duration long: run.duration must be a number, got 'long'"),
        (["--integrator", "euler"], "--integrator euler: run.integrator must be one of 'auto'"),
        (["--set", "motion.end=[9, 9]"], "--set motion.end=[9, 9]: motion.end must lie within"),
    ],
)
def test_wrong_set_options_give_the_messages_of_the_file(good, options, message):
    outcome = invoke("run", good, *options)
    assert outcome.exit_code == 2
    assert outcome.stdout == ""
    assert message in outcome.stderr
    reported = " ".join(options)
    assert outcome.stderr.startswith((f"{reported}: ", "flexarm run: --set must"))


def test_json_is_the_only_standard_output(good, tmp_path):
    out = tmp_path / "run.nc"
    outcome = invoke("run", good, "--json", "--out", out)
    reported = json.loads(outcome.stdout)
    result = fa.read_result(out)
    assert reported["files"] == {"result": str(out)}
    assert reported["samples"] == result.sizes["time"]
    assert reported["end_time"] == float(result.time[-1])
    np.testing.assert_array_equal(reported["tip"], result.tip[-1])
    largest = np.abs(result.link_tip_deflection).max("time")
    np.testing.assert_array_equal(reported["largest_link_tip_deflection"], largest)
    assert reported["ended_by"] == "duration"


def test_the_summary_has_the_errors_of_the_task(good):
    """Oracle: the table of ``flexarm compare`` for the same drive, and the distance at the end."""
    assert json.loads(invoke("run", good, "--json").stdout)["errors"] == {}
    keys = (
        good.read_text()
        .replace("rate: 200", "rate: 1000")
        .replace("run: {duration: 0.05", "run: {duration: 0.2")
    )
    motion = "{kind: line, start: [0.8, 0.2], end: [0.2, 0.8], duration: 0.1}"
    drive = "{kind: joint_pd, proportional: 1.0, derivative: 0.02}"
    lines = [line for line in keys.splitlines() if not line.startswith(("motion", "drive"))]
    shared = "\n".join(lines) + "\n"
    good.write_text(f"{shared}motion: {motion}\ndrive: {drive}\n")
    study = good.with_name("study.yaml")
    study.write_text(f"{shared}motions: {{line: {motion}}}\ndrives: {{PD: {drive}}}\n")
    table = fa.run_study(study, progress=False)
    errors = json.loads(invoke("run", good, "--json").stdout)["errors"]
    for name in ("rms", "peak", "settled"):
        assert errors[f"tip_error_{name}"] == table[f"tip_error_{name}"].item() > 0.0
    result = fa.run_scenario(good, progress=False)
    end = np.hypot(*(result.tip.values[-1] - [0.2, 0.8]))
    assert errors["tip_error_end"] == pytest.approx(end, rel=1e-9)
    words = " ".join(invoke("run", good).stdout.split())
    most, rms = (1e3 * errors[f"tip_error_{name}"] for name in ("peak", "rms"))
    assert (
        f"tip error at most {most:.3g} mm, {rms:.3g} mm RMS in motion, {1e3 * end:.3g} mm" in words
    )


@pytest.mark.parametrize(
    ("length", "text"), [(25.0, "25 m"), (1.0, "1 m"), (0.9994, "999 mm"), (2e-7, "0.0002 mm")]
)
def test_lengths_of_a_metre_are_not_written_in_millimetres(length, text):
    assert length_text(length) == text


def test_quiet_prints_warnings_only(good):
    soft = ["--set", "arm.links[0].flexural_rigidity=0.05", "--set", "drive={kind: none}"]
    soft += ["--set", "arm.gravity=[0, -9.81]", "--duration", "0.3"]
    outcome = invoke("run", good, *soft, "--quiet")
    assert outcome.exit_code == 0
    assert outcome.stdout == ""
    assert outcome.stderr.startswith("warning: link 1 deflects by")
