"""Output and files of commands, for valid input and for failed runs."""

import csv
import json
import re

import numpy as np
import pytest
from scenarios import GOOD, UNSTABLE, invoke

import flexarm as fa
from flexarm.cases.results import read_result

ONE_LINK = """\
flexarm: 1
arm:
  links:
    - {length: 1, flexural_rigidity: 10, mass_per_length: 0.5, elements: 4, modes: 3}
motion: {kind: joint, start: [0.0], end: [1.0], duration: 0.5}
"""


def test_version():
    outcome = invoke("--version")
    assert outcome.exit_code == 0
    assert outcome.stdout == f"flexarm {fa.__version__}\n"


@pytest.mark.sampled("paper", "run", "check", "linearize", "schema", "init")
@pytest.mark.parametrize(
    "command", ["paper", "run", "check", "modes", "linearize", "schema", "init"]
)
def test_help_names_every_command_and_its_options(command):
    assert command in invoke("--help").stdout
    outcome = invoke(command, "--help")
    assert outcome.exit_code == 0
    if command not in ("check", "init"):
        assert "--out" in outcome.stdout or "--csv" in outcome.stdout


def test_check_prints_a_summary(good):
    outcome = invoke("check", good)
    assert outcome.exit_code == 0
    words = " ".join(outcome.stdout.split())
    assert "2 links, 6 coordinates, linear theory, no gravity" in words
    assert "link 2 0.5 m, 0.2 kg, 1 element, 2 modes" in words
    assert "line from (0.8, 0.2) to (0.2, 0.8) m in 0.05 s, within reach" in words
    assert words.endswith("ok")


def test_check_prints_instruments_and_motors_and_run_the_time_at_the_limits(good):
    good.write_text(
        ONE_LINK.replace("motion:", "  joints: [{hub_inertia: 0.1}]\nmotion:")
        + "drive: {kind: joint_pd, proportional: 2.0, derivative: 0.4}\n"
        + "hardware:\n"
        + "  instruments:\n"
        + "    - {signal: joint_angle, resolution: 1.0e-4, rate_cutoff: 200 Hz, delay: 1 ms}\n"
        + "    - {signal: acceleration, link: 1, name: knock, noise: 0.05}\n"
        + "  motors: {torque_limit: 0.5, time_constant: 2 ms}\n"
        + "run: {duration: 0.3}\n"
    )
    words = " ".join(invoke("check", good).stdout.split())
    for row in (
        "instrument joint_angle: resolution 0.0001 rad, delay 0.001 s, rate_cutoff 200 Hz",
        "instrument knock: link 1, noise 0.05 m/s^2",
        "motors torque_limit 0.5 N m, time_constant 0.002 s",
    ):
        assert f" {row} " in words
    outcome = invoke("check", good, "--json", "--set", "run.duration=0.3")
    summary = json.loads(outcome.stdout)
    rows = [f"{row['name']} {row['text']}" for row in summary["summary"]]
    # Lines break in the terminal only.
    assert " ".join([*rows, summary["conclusion"]]).split() == words.split()
    assert summary["changes"] == ["--set run.duration=0.3"]
    words = " ".join(invoke("run", good).stdout.split())
    (motor,) = json.loads(invoke("run", good, "--json").stdout)["motors"]
    result = fa.run_scenario(good, progress=False)
    assert motor == {
        "joint": 1,
        "saturation": result.saturation.item(),
        "longest": result.longest_saturation.item(),
    }
    # The controller requests a torque every millisecond, as often as the run is sampled.
    share = float((np.abs(result.torque_command) > 0.5).mean())
    assert 0.1 < share < 0.99
    shown = float(words.partition("motors at the limit: motor 1 ")[2].partition("%")[0])
    assert shown == pytest.approx(100.0 * share, abs=1.0)  # two samples of 300


def test_check_names_the_integrator_of_a_fixed_step(good):
    """`auto` with a step is another method than without one, as in the result."""

    def row(*sets):
        words = " ".join(invoke("check", good, *sets).stdout.split())
        return words.rpartition(" integrator ")[2]

    assert row().startswith("kennedy_carpenter_5 is recommended: ")
    used = "rk4 (fixed step requested); kennedy_carpenter_5 is recommended: "
    assert row("--set", "run.step=1e-5").startswith(used)
    used = "generalized_alpha (order 2 with bending implicit: a step covers "
    assert row("--set", "run.step=0.01").startswith(used)


def test_check_prints_frequencies_sample_time_integrator_and_stability(good):
    """The numbers equal those of the Python interface, and the closed form of a single joint."""
    good.write_text(
        ONE_LINK
        + "drive: {kind: joint_pd, proportional: 2.0, derivative: 0.4, sample_time: 0.002}\n"
        "run: {duration: 1.0, integrator: rk4, step: 1.0e-4}\n"
    )
    words = " ".join(invoke("check", good).stdout.split())
    arm = fa.load_arm(good)
    frequency = fa.modes(arm).frequency_hz
    # A clamped-free beam: 3.516 sqrt(EI / mu) / (2 pi L^2).
    assert frequency[0] == pytest.approx(3.516 * np.sqrt(20.0) / (2.0 * np.pi), rel=1e-3)
    reported = ", ".join(f"{value:.4g}" for value in frequency[:3])
    assert f"frequencies {reported} Hz with the joints locked, at the start" in words
    longest = float(words.partition("sample time ")[2].partition(" ms")[0])
    # Rounded down to two digits: 12 instead of 12.7.
    assert 0.18 < 2.0 * np.pi * frequency[0] * 1e-3 * longest <= 0.2
    assert "; this one has 2 ms" in words
    assert "integrator rk4; dormand_prince_8 is recommended: order 8 with step control" in words
    growth = fa.loop_margins(fa.JointPD(2.0, 0.4, sample_time=0.002), arm, [[0.0]]).growth
    time = f"decays tenfold in {np.log(10.0) / -float(growth[0, 0]):.2g} s"
    for when in ("at the start", "at the end of the motion"):
        assert f"stable {when}: the slowest pole, at " in words
    assert words.count(time) == 2


def test_check_reports_an_unstable_pole(good):
    good.write_text(
        ONE_LINK + "drive: {kind: joint_pd, proportional: 2.0, derivative: 2.0, sample_time: 0.1}\n"
        "run: {duration: 1.0}\n"
    )
    outcome = invoke("check", good)
    assert "unstable at the start: the fastest pole" in " ".join(outcome.stdout.split())
    assert "warning: the sampled loop is unstable at the start" in outcome.stderr
    summary = json.loads(invoke("check", good, "--json").stdout)
    assert f"warning: {' '.join(summary['warnings'])}" == " ".join(outcome.stderr.split())
    assert summary["conclusion"] == outcome.stdout.splitlines()[-1] == "ok, but for the warning"


def test_check_calls_a_loop_without_feedback_neutral(good):
    rigid = ONE_LINK.replace("flexural_rigidity: 10", "flexible: false")
    rigid = rigid.replace(", elements: 4, modes: 3", "")
    drive = "drive: {kind: joint_pd, proportional: 0.0, derivative: 0.0}\n"
    good.write_text(f"{rigid}{drive}run: {{duration: 1.0}}\n")
    words = " ".join(invoke("check", good).stdout.split())
    assert "loop neutral at the start: a pole at 0 Hz neither grows nor decays; neutral at" in words


@pytest.mark.thorough
def test_check_warns_of_growth_that_the_run_does_not_show(good):
    """Strain feedback with the wrong sign, as of a gauge on the other side of its link."""
    arm = ONE_LINK.replace("modes: 3}", "modes: 3, gauges: [{station: 0.02, distance: 0.004}]}")
    drive = "drive: {kind: strain_feedback, proportional: 5, derivative: 0.2, strain: GAIN}\n"
    for gain, slow in (("2.6e+3", False), ("-2.6e+3", True)):  # growth -0.26 and 1.3 1/s
        good.write_text(arm + drive.replace("GAIN", gain) + "run: {duration: 1.0}\n")
        for outcome in (invoke("check", good), invoke("run", good, "--quiet")):
            assert ("slowly unstable at the start" in outcome.stderr) == slow


def test_check_and_modes_accept_other_values(good):
    change = ("--set", "arm.payload.mass=0.7")
    given, heavier = invoke("check", good), invoke("check", good, *change)
    assert heavier.exit_code == 0
    assert heavier.stdout != given.stdout
    given, heavier = invoke("modes", good), invoke("modes", good, *change)
    assert heavier.exit_code == 0
    assert heavier.stdout != given.stdout
    for command in ("check", "modes"):
        wrong = invoke(command, good, "--set", "arm.payload.mass=-1")
        assert wrong.exit_code == 2
        assert "--set arm.payload.mass=-1: arm.payload.mass must be at least 0" in wrong.stderr


def test_check_counts_segments(good):
    good.write_text(GOOD.replace("elements: 1", "elements: 2, segments: 2", 1))
    outcome = invoke("check", good)
    assert outcome.exit_code == 0
    assert "2 segments, 2 elements, 4 modes" in " ".join(outcome.stdout.split())


def test_check_accepts_an_arm_file(good, tmp_path):
    fa.save_arm(fa.load_arm(good), tmp_path / "arm.yaml")
    outcome = invoke("check", tmp_path / "arm.yaml")
    assert outcome.exit_code == 0
    assert "2 links" in outcome.stdout
    assert "motion" not in outcome.stdout


def test_scenario_without_run_is_not_an_arm_file(good):
    good.write_text(GOOD[: GOOD.index("run:")])
    outcome = invoke("check", good)
    assert outcome.exit_code == 2
    assert "run is missing" in outcome.stderr


@pytest.mark.thorough
def test_run_writes_the_result_of_the_same_calls_in_python(good, tmp_path):
    out, plot, page = tmp_path / "new" / "run.nc", tmp_path / "run.png", tmp_path / "run.html"
    outcome = invoke("run", good, "--out", out, "--plot", plot, "--animate", page)
    assert outcome.exit_code == 0
    assert f"animation in {page}" in outcome.stdout
    assert page.read_text(encoding="utf-8") == fa.animate(fa.run_scenario(good)).html()
    result, expected = read_result(out), fa.run_scenario(good)
    for name in expected.data_vars:
        assert np.array_equal(result[name], expected[name])
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert plot.stat().st_size > 20_000
    x, y = result["tip"].values[-1]
    assert f"({x:.6g}, {y:.6g}) m at the end" in outcome.stdout


def test_run_without_output_writes_nothing(good, tmp_path):
    assert invoke("run", good).exit_code == 0
    assert list(tmp_path.iterdir()) == [good]


@pytest.mark.thorough
def test_excessive_bending_gives_a_warning_of_one_line(tmp_path):
    path = tmp_path / "soft.yaml"
    path.write_text(GOOD.replace("5000.0", "500.0"))
    outcome = invoke("run", path, "--out", tmp_path / "run.nc")
    assert outcome.exit_code == 0
    (line,) = outcome.stderr.splitlines()
    reported = read_result(tmp_path / "run.nc").attrs["warning"]
    assert line == f"warning: {reported}"
    assert reported.startswith("link 1 deflects by up to ")


@pytest.mark.sampled(".csv")
@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_failed_run_writes_its_partial_result(suffix, tmp_path):
    path = tmp_path / "unstable.yaml"
    path.write_text(UNSTABLE)
    outcome = invoke("run", path, "--out", tmp_path / f"run{suffix}")
    assert outcome.exit_code == 1
    assert "Traceback" not in outcome.output
    part = tmp_path / f"run.partial{suffix}"
    assert sorted(tmp_path.iterdir()) == sorted([path, part])
    first, last = outcome.stderr.splitlines()
    assert str(part) in first
    assert last.startswith("stopped at t = ")
    if suffix == ".nc":
        assert read_result(part).attrs["failure"] == last


def test_failed_run_without_output_writes_nothing(tmp_path):
    path = tmp_path / "unstable.yaml"
    path.write_text(UNSTABLE)
    assert invoke("run", path).exit_code == 1
    assert list(tmp_path.iterdir()) == [path]


def test_ctrl_c_and_memory_error_print_no_traceback(good, monkeypatch):
    from flexarm.cases.scenario.scenario import Prepared

    for error, status in ((KeyboardInterrupt, 130), (MemoryError, 1)):

        def stop(*_, kind=error, **__):
            raise kind

        monkeypatch.setattr(Prepared, "run", stop)
        outcome = invoke("run", good)
        assert outcome.exit_code == status
        assert len(outcome.stderr.splitlines()) == 1


@pytest.mark.parametrize("joints", ["locked", "free"])
def test_modes_prints_the_frequencies_of_the_arm(joints, good, tmp_path):
    table = tmp_path / "modes.csv"
    options = ["--joints", joints, "--angles", "0.3,-0.5", "--count", "3", "--csv", table]
    outcome = invoke("modes", good, *options)
    assert outcome.exit_code == 0
    expected = fa.modes(fa.load_arm(good), [0.3, -0.5], joints)
    with open(table, newline="") as stream:
        head, *rows = csv.reader(stream)
    assert head[:3] == ["mode", "frequency [Hz]", "damping_ratio [1]"]
    frequencies = [float(row[1]) for row in rows]
    assert frequencies == expected.frequency_hz.tolist()
    shown = [line.split() for line in outcome.stdout.splitlines() if line.strip()[:1].isdigit()]
    assert [row[0] for row in shown] == ["1", "2", "3"]
    for row, frequency in zip(shown, frequencies, strict=False):
        assert float(row[1]) == pytest.approx(frequency, rel=1e-5)


def test_modes_of_arms_without_vibrations(tmp_path):
    path = tmp_path / "rigid.yaml"
    path.write_text(
        "flexarm: 1\n"
        "arm: {gravity: [0, -9.81], links: [{length: 1, mass_per_length: 1, flexible: false}]}\n"
    )
    assert "every link is rigid" in invoke("modes", path).stdout
    upright = invoke("modes", path, "--joints", "free", "--angles", "1.5708")
    assert "unstable" in upright.stdout
    hanging = invoke("modes", path, "--joints", "free", "--angles", "-1.5708")
    # a rod about its end: sqrt(3 g / 2 L)
    assert f"{np.sqrt(1.5 * 9.81) / (2 * np.pi):.5f}" in hanging.stdout


@pytest.mark.sampled("scenario")
@pytest.mark.parametrize("kind", ["arm", "scenario"])
def test_schema_is_printed_or_written_as_json(kind, tmp_path):
    outcome = invoke("schema", "--kind", kind)
    assert outcome.exit_code == 0
    schema = json.loads(outcome.stdout)
    assert kind in schema["title"]
    file = tmp_path / "schema.json"
    assert invoke("schema", "--kind", kind, "--out", file).exit_code == 0
    assert json.loads(file.read_text()) == schema


def test_run_prints_the_events_that_occurred(tmp_path):
    path = tmp_path / "run.yaml"
    events = (
        "events:\n"
        "  - {kind: joint_angle, joint: 1, angle: 0.0, name: never}\n"
        "  - {kind: tip_line, point: [0.5, 0.0], normal: [-1, 0], name: half way}\n"
        "  - {kind: tip_line, point: [0.3, 0.0], normal: [1, 0], terminal: true}\n"
    )
    path.write_text(GOOD + events)
    output = invoke("run", path).stdout
    assert "half way: at t = 0.0" in output
    assert "event_3: at t = 0.0" in output
    assert "never" not in output
    assert re.search(r"ended by +event_3", output)
    path.write_text(GOOD + events.partition("  - {kind: tip_line")[0])
    assert re.search(r"events +none", invoke("run", path).stdout)
    assert "ended by" not in invoke("run", path).stdout
    assert re.search(r"event +joint angle", invoke("check", path).stdout)


RELIES_ON_DAMPING = """\
flexarm: 1
arm:
  links:
    - {length: 0.8, material: aluminium, section: {kind: rectangle, width: 0.05, height: 0.006},
       elements: 2, damping: {kind: modal, ratio: 0.0}}
    - {length: 0.6, material: aluminium, section: {kind: rectangle, width: 0.04, height: 0.004},
       elements: 2, damping: {kind: modal, ratio: 0.0}}
  joints: [{hub_inertia: 0.05}, {mass: 0.8, hub_inertia: 0.01}]
  payload: {mass: 0.3}
motion: {kind: joint, start: [0.5, 0.7], end: [0.51, 0.7], duration: 0.01}
drive: {kind: loop_shaping, posture: [0.5, 0.7], bandwidth: 10.0, rigidity_uncertainty: 1.0}
run: {duration: 0.01}
"""


@pytest.mark.thorough_cases("run")
@pytest.mark.parametrize("command", ["run", "check"])
def test_warnings_of_the_design_of_a_drive_are_one_line(tmp_path, command):
    path = tmp_path / "scenario.yaml"
    path.write_text(RELIES_ON_DAMPING)
    outcome = invoke(command, path)
    assert outcome.exit_code == 0
    lines = outcome.stderr.splitlines()
    assert len([one for one in lines if "The loop with the arm itself is unstable" in one]) == 1
    assert all(one.startswith("warning: ") for one in lines)


def test_warnings_of_the_design_of_a_drive_are_in_the_summary(tmp_path):
    path = tmp_path / "scenario.yaml"
    path.write_text(RELIES_ON_DAMPING)
    texts = json.loads(invoke("run", path, "--json").stdout)["warnings"]
    assert sum("The loop with the arm itself is unstable" in text for text in texts) == 1
