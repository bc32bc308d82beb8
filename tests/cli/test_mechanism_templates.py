"""``flexarm init --mechanism``: the files run, animate, and say what they are."""

from __future__ import annotations

import pytest
from scenarios import invoke

import flexarm as fa
from flexarm.cases.results import read_result
from flexarm.cases.templates import MECHANISMS


@pytest.mark.parametrize("kind", sorted(MECHANISMS))
def test_files_of_a_mechanism_run(kind, tmp_path):
    answer = invoke("init", str(tmp_path / kind), "--mechanism", kind)
    assert answer.exit_code == 0
    scenario = str(tmp_path / kind / "scenario.yaml")
    page = tmp_path / "page.html"
    answer = invoke("run", scenario, "--out", str(tmp_path / "run.nc"), "--animate", str(page))
    assert answer.exit_code == 0, answer.stderr
    run = read_result(tmp_path / "run.nc")
    assert run.time.values[-1] == pytest.approx(2.0)
    arm = fa.load_arm(str(tmp_path / kind / "arm.yaml"))
    gaps = [abs(arm.closure_gaps(q)).max(initial=0.0) for q in run.q.values]
    assert max(gaps) < 1e-9 * arm.reach
    assert not arm.spec.is_serial
    assert page.stat().st_size > 0


def test_unknown_mechanism_is_an_error(tmp_path):
    answer = invoke("init", str(tmp_path / "new"), "--mechanism", "hexapod")
    assert answer.exit_code == 2
    assert "--mechanism must be one of four-bar" in answer.stderr
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(("kind", "advised"), [("free-flyer", False), ("gantry", True)])
def test_check_names_converged_only_for_arms_that_it_accepts(kind, advised, tmp_path):
    invoke("init", str(tmp_path / kind), "--mechanism", kind)
    answer = invoke("check", str(tmp_path / kind / "scenario.yaml"))
    assert answer.exit_code == 0
    assert ("fa.converged" in answer.stdout) == advised
    features = fa.load_arm(str(tmp_path / kind / "arm.yaml")).spec.features
    assert advised == {"branches", "closures"}.isdisjoint(features)
