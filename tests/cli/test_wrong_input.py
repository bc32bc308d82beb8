"""Wrong input of any kind gives one clear message, exit status 2 and no output file."""

import re

import pytest
from scenarios import GOOD, WRONG, invoke

#: Pattern of a rule with its value, or of a statement about the input.
MESSAGE = re.compile(
    r"^.+: .+ (must .+, got .+|(is|are|has|have|does|cannot|could|requires|refers|names|contains|"
    r"lies|repeats) .+)\."
)


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def assert_rejected(outcome):
    assert outcome.exit_code == 2
    assert "Traceback" not in outcome.output
    reported = outcome.stderr.splitlines()
    assert reported
    for line in reported:
        assert MESSAGE.match(line), line


@pytest.mark.parametrize("what", WRONG)
def test_check_rejects_wrong_files(what, tmp_path):
    content, part = WRONG[what]
    outcome = invoke("check", write(tmp_path / "bad.yaml", content))
    assert_rejected(outcome)
    assert part in outcome.stderr
    assert "ok" not in outcome.stdout


@pytest.mark.parametrize("what", WRONG)
def test_run_rejects_wrong_files_and_writes_nothing(what, tmp_path):
    content, part = WRONG[what]
    bad = write(tmp_path / "bad.yaml", content)
    out, plot = tmp_path / "run.nc", tmp_path / "run.png"
    outcome = invoke("run", bad, "--out", out, "--plot", plot)
    assert_rejected(outcome)
    assert part in outcome.stderr
    assert list(tmp_path.iterdir()) == [bad]


@pytest.mark.parametrize("command", ["check", "run", "modes"])
def test_missing_file_is_rejected(command, tmp_path):
    outcome = invoke(command, tmp_path / "none.yaml")
    assert_rejected(outcome)
    assert "does not exist" in outcome.stderr


@pytest.mark.parametrize("command", ["check", "run", "modes"])
def test_folder_in_place_of_a_file_is_rejected(command, tmp_path):
    assert_rejected(invoke(command, tmp_path))


def test_all_problems_are_reported_with_their_lines(tmp_path):
    text = GOOD.replace("length: 0.6", "length: -1").replace("rate: 200", "rates: 200")
    outcome = invoke("check", write(tmp_path / "bad.yaml", text))
    assert_rejected(outcome)
    lines = [line.split(": ")[0].rpartition(":")[2] for line in outcome.stderr.splitlines()]
    assert lines == ["4", "8"]


OUTPUTS = {
    "unknown suffix": "run.txt",
    "no suffix": "run",
    "under a file": "good.yaml/run.nc",
    "a folder": "folder.nc",
}


@pytest.mark.parametrize("what", OUTPUTS)
@pytest.mark.parametrize("option", ["--out", "--plot", "--animate"])
def test_unwritable_path_is_rejected_before_the_run(what, option, tmp_path, monkeypatch):
    from flexarm.cases.scenario.scenario import Prepared

    monkeypatch.setattr(Prepared, "run", lambda *_, **__: pytest.fail("it ran"))
    good = write(tmp_path / "good.yaml", GOOD)
    (tmp_path / "folder.nc").mkdir()
    before = sorted(tmp_path.rglob("*"))
    name = OUTPUTS[what]
    if option != "--out":
        suffix = ".png" if option == "--plot" else ".html"
        name = name.replace(".nc", suffix)
        (tmp_path / "folder.nc").rename(tmp_path / f"folder{suffix}")
        before = sorted(tmp_path.rglob("*"))
    outcome = invoke("run", good, option, tmp_path / name)
    assert_rejected(outcome)
    assert f"flexarm run: {option} must" in outcome.stderr
    assert sorted(tmp_path.rglob("*")) == before


STUDY = GOOD.replace("motion: {", "motions: {there: {").replace(
    "0.05}\ndrive: {", "0.05}}\ndrives: {a: {"
)
STUDY = STUDY.replace("dynamics}", "dynamics}}")


@pytest.mark.parametrize(
    ("command", "content", "reported"),
    [
        (
            "run",
            STUDY,
            "is a study, not a scenario. Run it with `flexarm compare`, or with ",
        ),
        ("compare", GOOD, "is a scenario, not a study. Run it with `flexarm run`, or with "),
        (
            "compare",  # a minimal scenario: only an arm and a run
            "\n".join(line for line in GOOD.splitlines() if line[:3] not in ("mot", "dri")),
            "Run it with `flexarm run`, or with run_scenario in Python.",
        ),
    ],
)
def test_file_of_another_kind_names_its_command(command, content, reported, tmp_path):
    outcome = invoke(command, write(tmp_path / "file.yaml", content))
    assert_rejected(outcome)
    assert reported in outcome.stderr
    assert len(outcome.stderr.splitlines()) == 1


def test_files_of_these_tests_have_the_intended_kind(tmp_path):
    for command, content in (("compare", STUDY), ("run", GOOD)):
        assert invoke(command, write(tmp_path / "a.yaml", content)).exit_code == 0


@pytest.mark.parametrize(
    "angles", ["0.1", "0.1,0.2,0.3", "a,b", "", "nan,0", "1e400,0", "0.1;0.2", ","]
)
def test_wrong_number_of_angles_is_rejected(angles, tmp_path):
    good = write(tmp_path / "good.yaml", GOOD)
    outcome = invoke("modes", good, "--angles", angles)
    assert_rejected(outcome)
    assert "--angles must be 2 numbers" in outcome.stderr


def test_modes_and_schema_check_their_output_paths(tmp_path):
    good = write(tmp_path / "good.yaml", GOOD)
    assert_rejected(invoke("modes", good, "--csv", tmp_path / "a.nc"))
    assert_rejected(invoke("schema", "--out", tmp_path / "a.yaml"))
    assert list(tmp_path.iterdir()) == [good]


DEEP = """
flexarm: 1
arm:
  links:
    - {length: 1.0, mass_per_length: 1.0, flexible: false}
motion: {kind: joint, start: [0.0], end: [0.5], duration: 1.0}
drive: {kind: joint_pd, proportional: 20, derivative: 4}
contacts:
  - surface: {kind: wall, point: [0.5, 0.0], normal: [-1, 0]}
    stiffness: 1.0e+4
run: {duration: 0.5}
"""


@pytest.mark.parametrize("command", ["check", "run"])
def test_start_deep_in_a_wall_is_rejected_before_the_run(tmp_path, command):
    outcome = invoke(command, write(tmp_path / "deep.yaml", DEEP))
    assert_rejected(outcome)
    assert "deep.yaml" in outcome.stderr
    assert "outside the surface of contact 1, got 0.5 m inside" in outcome.stderr


def test_paper_rejects_a_file_for_a_folder(tmp_path):
    good = write(tmp_path / "good.yaml", GOOD)
    assert_rejected(invoke("paper", "--out", good))


@pytest.mark.parametrize(
    "arguments",
    [
        ["bogus"],
        ["run"],
        ["check", "a.yaml", "b.yaml"],
        ["modes", "a.yaml", "--count", "0"],
        ["modes", "a.yaml", "--count", "many"],
        ["modes", "a.yaml", "--joints", "loose"],
        ["--bogus"],
    ],
)
def test_wrong_usage_is_rejected(arguments):
    outcome = invoke(*arguments)
    assert outcome.exit_code == 2
    assert "Traceback" not in outcome.output
    assert "Usage" in outcome.stderr


@pytest.mark.parametrize(
    ("command", "hint"), [("modess", "Did you mean 'modes'?"), ("rprt", "Did you mean 'report'?")]
)
def test_unknown_commands_have_a_suggestion(command, hint):
    outcome = invoke(command)
    assert outcome.exit_code == 2
    assert f"No such command '{command}'. {hint}" in outcome.stderr
    assert "Did you mean" not in invoke("xyzzy").stderr
