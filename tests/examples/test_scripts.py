"""The scripts in ``examples/`` print the numbers stated in their first lines, and draw a figure."""

import re
import runpy
import sys
from pathlib import Path

import pytest

SCRIPTS = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))


@pytest.mark.thorough_cases("train_agent")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_script_prints_the_stated_number_and_draws_a_figure(script, tmp_path, monkeypatch, capsys):
    promised = re.search(r"^Prints: (.*)$", script.read_text(encoding="utf-8"), re.MULTILINE)
    figure = tmp_path / "figure.png"
    monkeypatch.setattr(sys, "argv", [str(script), str(figure)])
    runpy.run_path(str(script), run_name="__main__")
    assert capsys.readouterr().out == f"{promised[1]}\n"
    assert figure.stat().st_size > 10_000


def test_at_least_one_script_exists():
    assert len(SCRIPTS) >= 2
