"""The Python script of a studio window runs and gives the same numbers."""

import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from flexarm.view.studio.script import script_of
from flexarm.view.studio.state import open_bytes, open_file, paper_project

from test_state import STUDY  # isort: skip

ROOT = Path(__file__).parents[3]
EXAMPLES = [
    *sorted(path for path in (ROOT / "examples").rglob("*.yaml") if path.stem != "identify"),
    ROOT / "tests/unit/studio/every_part.yaml",
]


def run(text, tmp_path):
    path = tmp_path / "script.py"
    path.write_text(text, encoding="utf-8")
    return runpy.run_path(str(path))


def test_script_gives_the_numbers_of_the_window(tmp_path):
    project = paper_project().edited(("drive", "kind"), "joint_pd")
    project = project.edited(("arm", "links", 0, "length"), 1.3)
    project = project.edited(("run", "duration"), 0.5)
    found = run(script_of(project), tmp_path)
    assert found["scenario"] == project.scenario
    expected = fa.run_scenario(project.scenario)
    np.testing.assert_array_equal(found["result"].tip, expected.tip)
    np.testing.assert_array_equal(found["result"].q, expected.q)


@pytest.mark.thorough
def test_script_simulates_the_plant_of_a_study(tmp_path):
    from flexarm.cases.scenario.study import PreparedStudy

    project = open_bytes(STUDY.encode(), "s").chosen(drive="joint PD", plant="heavier")
    found = run(script_of(project), tmp_path)
    study = PreparedStudy(project.record)
    expected, _ = study.one("joint PD", "heavier", "slow")
    np.testing.assert_array_equal(found["result"].tip, expected.tip)


@pytest.mark.thorough
def test_script_runs_as_a_program(tmp_path):
    path = tmp_path / "paper.py"
    path.write_text(script_of(paper_project()), encoding="utf-8")
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=300)
    assert done.stderr == ""
    tip = fa.run_scenario(paper_project().scenario).tip[-1].values
    line = next(line for line in done.stdout.splitlines() if line.startswith("tip at the end"))
    assert [float(word) for word in line.split()[-2:]] == tip.tolist()


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_script_describes_every_example_completely(file, tmp_path):
    project = open_file(file)
    text = script_of(project).split("\nresult = ")[0].split("# The simulated arm")[0]
    assert run(text, tmp_path)["scenario"] == project.scenario
    assert max(map(len, text.splitlines())) < 120


@pytest.mark.thorough
def test_it_runs_a_scenario_with_every_part(tmp_path):
    project = open_file(EXAMPLES[-1])
    expected = fa.run_scenario(project.scenario)
    np.testing.assert_array_equal(run(script_of(project), tmp_path)["result"].q, expected.q)


def test_names_in_a_file_are_quoted_not_executed(tmp_path):
    bad = "x'); raise SystemExit('executed') #"
    study = STUDY.replace("joint PD", f'"{bad}"').replace(
        "payload: {mass: 0.1}", "payload: {mass: 0.1}"
    )
    project = open_bytes(study.encode(), "s").chosen(drive=bad)
    text = script_of(project).split("\nresult = ")[0]
    assert run(text, tmp_path)["scenario"] == project.scenario
