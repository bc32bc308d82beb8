"""The Python script of a studio window runs and gives the same numbers."""

import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import flexarm as fa
from flexarm.model.drives import CONTROLLED, FEEDFORWARD_DRIVES
from flexarm.view.studio.presets import PRESETS, paper_project
from flexarm.view.studio.script import script_of
from flexarm.view.studio.state import open_bytes, open_file

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
    expected = fa.run_scenario(project.scenario)
    np.testing.assert_array_equal(found["result"].tip, expected.tip)
    np.testing.assert_array_equal(found["result"].q, expected.q)


def short(project):
    """The project with a run of a tenth of a second."""
    return project.edited(("run", "duration"), 0.1)


@pytest.mark.parametrize("name", PRESETS)
def test_scripts_of_presets_have_no_internal_names_and_the_same_result(name, tmp_path):
    project = short(PRESETS[name]())
    text = script_of(project)
    # A base that moves, and torques of samples, are written as the record of a file.
    if PRESETS[name]().record.drive.kind != "torque":
        imports = [line for line in text.splitlines() if " import " in line or "import " in line]
        assert imports == ["import flexarm as fa"]
        assert "fa.Arm(" in text
        assert "fa.simulate(" in text
    found = run(text, tmp_path)["result"]
    np.testing.assert_array_equal(found.q, fa.run_scenario(project.scenario).q)


#: Drives that need hardware, gauges or a motion that the arm below does not have.
_OTHER = ("strain_feedback", "mu_synthesis", "tip_inversion", "torque", "estimator", "none")
_MODAL = [kind for kind, record in CONTROLLED.items() if "modes" in record.model_fields]
DRIVES = [k for k in (*CONTROLLED, *FEEDFORWARD_DRIVES) if k not in (*_OTHER, *_MODAL)]


@pytest.mark.parametrize("kind", DRIVES)
def test_scripts_construct_every_controller(kind, tmp_path):
    project = short(PRESETS["two links"]()).edited(("drive", "kind"), kind)
    text = script_of(project)
    assert "fa.Arm(" in text
    found = run(text, tmp_path)["result"]
    np.testing.assert_array_equal(found.q, fa.run_scenario(project.scenario).q)


def test_script_of_a_design_with_the_hardware_of_the_scenario(tmp_path):
    project = short(PRESETS["two links"]()).edited(("drive", "kind"), "lqg")
    project = project.edited(("hardware",), {"motors": {"delay": 0.001, "time_constant": 0.001}})
    project = project.edited(("drive", "hardware"), True)
    text = script_of(project)
    assert text.count("fa.Motors(") == 1
    found = run(text, tmp_path)["result"]
    np.testing.assert_array_equal(found.q, fa.run_scenario(project.scenario).q)


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


def test_a_script_runs_both_drives_and_builds_the_arm_once(tmp_path):
    project = short(PRESETS["two links"]())
    other = project.edited(("drive", "kind"), "computed_torque")
    text = script_of(replace(project, beside=other.scenario.drive))
    assert text.count("fa.Arm(") == text.count("motion = ") == 1
    written = run(text, tmp_path)
    for name, side in (("result", project), ("beside", other)):
        np.testing.assert_array_equal(written[name].q, fa.run_scenario(side.scenario).q)
    assert not np.array_equal(written["result"].q, written["beside"].q)


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_script_describes_every_example_completely(file, tmp_path):
    project = open_file(file)
    text = script_of(project)
    assert max(map(len, text.splitlines())) < 120
    described = run(text.split("\nresult = ")[0].split("\nbent = ")[0], tmp_path)
    if "scenario" in described:
        assert described["scenario"] == project.scenario
    else:
        assert described["arm"].spec == project.record.arm


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
    found = run(script_of(project), tmp_path)["result"]
    np.testing.assert_array_equal(found.q, fa.run_scenario(project.scenario).q)
