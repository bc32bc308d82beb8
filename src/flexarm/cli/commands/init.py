"""``flexarm init``: write an arm and a scenario to start from."""

from __future__ import annotations

import os
from pathlib import Path

from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.writing.places import check_folder, write_text
from flexarm.cli.starting_files import arm_text, scenario_text
from flexarm.cli.tables import console


def write_starting_files(folder: Path, links: int, gravity: bool) -> None:
    """Write ``arm.yaml`` and ``scenario.yaml`` with comments, and print what to do next.

    Args:
        folder: where to write; created if missing.
        links: number of links, 1 to 8.
        gravity: whether the arm moves in a vertical plane.

    Raises:
        InputError: if one of the files exists, or the folder cannot be written in; nothing is
            written then.
    """
    texts = {
        folder / "arm.yaml": arm_text(links, gravity),
        folder / "scenario.yaml": scenario_text(links, gravity),
    }
    hint = "Give another folder: flexarm init FOLDER."
    found = [
        Problem(shown(str(path)), "already exists", hint=hint)
        for path in texts
        if os.path.lexists(path)
    ]
    if found:
        raise InputError(*found)
    check_folder("FOLDER", folder)
    for path, text in texts.items():
        write_text(text, path)
    screen = console()
    arm, scenario = texts
    screen.print(f"arm in {arm}", soft_wrap=True)
    screen.print(f"scenario in {scenario}", soft_wrap=True)
    page = folder / "arm.html"
    screen.print(f"next: flexarm check {scenario}", soft_wrap=True)
    screen.print(f"      flexarm run {scenario} --animate {page}", soft_wrap=True)
