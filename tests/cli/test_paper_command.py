"""``flexarm paper`` writes every figure, the data and the numbers."""

import html

import numpy as np
import pytest
from typer.testing import CliRunner

from flexarm.cases.results import read_result
from flexarm.cli.commands import paper as drawing
from flexarm.cli.main import app
from flexarm.model import load_scenario
from flexarm.view.paper import paper_scenario
from flexarm.view.plot.paper.paper_data import FIGURE_NAMES

pytestmark = pytest.mark.thorough


def reproduce(folder, *options):
    given = ["paper", "--out", str(folder), *options]
    outcome = CliRunner().invoke(app, given, catch_exceptions=False)
    assert outcome.exit_code == 0
    assert outcome.stderr == ""
    return outcome.stdout


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper") / "new" / "folder"
    return folder, reproduce(folder)


def test_every_file_is_written(done):
    folder, _ = done
    names = (*FIGURE_NAMES, "overview", "theories")
    data = {"result.nc", "result_rigid.nc", "numbers.txt", "paper.yaml"}
    figures = {f"{name}{suffix}" for name in names for suffix in (".png", ".pdf")}
    assert {path.name for path in folder.iterdir()} == figures | data
    for name in names:
        assert (folder / f"{name}.png").stat().st_size > 20_000
        assert (folder / f"{name}.pdf").stat().st_size > 5_000


def test_table_is_printed(done):
    folder, screen = done
    rows = {
        line.split("]")[0].strip(): line.split("]")[1].split()
        for line in screen.splitlines()
        if line.count("]") == 1 and line.split("]")[1].strip()
    }
    assert rows["joint 1: torque [N m"] == ["-2.22", "to", "2.80", "-8.87", "to", "11.21"]
    slow, fast = map(float, rows["link 1: peak deflection [mm"])
    assert slow == pytest.approx(fast / 4.0, rel=0.1)
    assert fast == pytest.approx(78.0, rel=0.02)
    assert max(len(line) for line in screen.splitlines() if str(folder) not in line) <= 80
    assert (folder / "numbers.txt").read_text(encoding="utf-8").splitlines()[:10] == [
        *map(str, screen.splitlines()[:10])
    ]


def test_data_equal_those_of_the_figures(done):
    folder, _ = done
    rigid = read_result(folder / "result_rigid.nc")
    assert rigid.time.values == pytest.approx(np.arange(3001) / 1000)
    assert rigid.tip.values[[0, 2000]] == pytest.approx(
        np.array([[2.0, 1.0], [1.0, 2.0]]), abs=1e-6
    )
    flexible = read_result(folder / "result.nc")
    assert float(abs(flexible.link_tip_deflection).max()) == pytest.approx(0.01912, rel=1e-3)


def test_written_scenario_gives_the_same_run(done):
    folder, _ = done
    assert load_scenario(folder / "paper.yaml") == paper_scenario()


def no_processes(monkeypatch):
    def refuse(*_, **__):
        raise OSError("no semaphores")

    monkeypatch.setattr(drawing, "process_pool", refuse)


def test_without_worker_processes_the_figures_are_the_same(done, tmp_path, monkeypatch):
    no_processes(monkeypatch)
    reproduce(tmp_path, "--report")
    folder, _ = done
    for path in folder.glob("*.png"):
        assert (tmp_path / path.name).read_bytes() == path.read_bytes()
    assert {p.name for p in tmp_path.iterdir()} - {p.name for p in folder.iterdir()} == {
        "report.html"
    }
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "numbers.txt").read_text(encoding="utf-8").strip() in html.unescape(page)
    assert len(page.encode()) < 5_000_000


@pytest.mark.parametrize("trouble", ["one core", "no processes"])
def test_without_worker_processes_tasks_run_in_this_process(trouble, monkeypatch):
    if trouble == "one core":
        monkeypatch.setattr(drawing, "usable_cores", lambda: 1)
    else:
        no_processes(monkeypatch)
    with drawing.drawing() as draw:
        assert draw is drawing.draw_figures
