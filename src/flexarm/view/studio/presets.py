"""States to start from: the paper's arm, those of ``flexarm init``, and cards of the gallery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from importlib.resources import files

from flexarm.cases.templates import MECHANISMS, arm_files, mechanism_files
from flexarm.view.studio.state import Project, open_bytes


def paper_project() -> Project:
    """Return the paper's example, the state of a studio without a file."""
    from flexarm.view.paper import paper_scenario

    return Project(paper_scenario(), "paper")


def _of_texts(arm: str, scenario: str, name: str) -> Project:
    """Return the project of the texts of an arm file and of a scenario file that names it."""
    described = open_bytes(arm.encode(), "arm.yaml").record.arm
    return open_bytes(scenario.encode(), name, {"arm.yaml": described})


def _mechanism(kind: str) -> Project:
    return _of_texts(*mechanism_files(kind), kind)


#: States to start from, by their entries in the menu: the paper's, and those of ``flexarm init``.
PRESETS: dict[str, Callable[[], Project]] = {
    "one link": lambda: _of_texts(*arm_files(1), "one link"),
    "two links": lambda: _of_texts(*arm_files(), "two links"),
    "stiff links": lambda: _of_texts(*arm_files(stiff=True), "stiff links"),
    "a boom under gravity": lambda: _of_texts(*arm_files(gravity=True), "boom"),
    "the arm of the paper": paper_project,
    **{summary: partial(_mechanism, kind) for kind, summary in MECHANISMS.items()},
}


@cache
def cards() -> list[tuple[str, str, Callable[[], Project]]]:
    """Return title, sentence and project of each card of the gallery, from its file."""
    entries = []
    for path in (files("flexarm") / "library" / "cards").iterdir():
        text = path.read_text(encoding="utf-8")
        title, sentence = text.splitlines()[0].removeprefix("# ").split(": ", 1)
        entries.append((title, sentence, partial(_card, text, path.name)))
    return sorted(entries, key=lambda entry: entry[0])


def _card(text: str, file: str) -> Project:
    """Return the project of a card; the second drive of a study is shown beside the first."""
    project = open_bytes(text.encode(), file)
    drives = list(getattr(project.record, "drives", {}).values())
    return replace(project, beside=drives[1]) if len(drives) > 1 else project
