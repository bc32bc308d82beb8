"""``flexarm init``: write an arm and a scenario with comments to start from."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.cases.templates import MECHANISMS, MOST_LINKS, arm_files, mechanism_files
from flexarm.cli.options import argument, flag
from flexarm.cli.tables import print_line

_KINDS = ", ".join(MECHANISMS)


def init(
    folder: Annotated[Path, argument("[FOLDER]", "Output folder; created if missing.")] = Path(),
    links: Annotated[int, typer.Option(min=1, max=MOST_LINKS, help="Number of links.")] = 2,
    gravity: Annotated[bool, flag("--gravity", "The arm moves in a vertical plane.")] = False,
    stiff: Annotated[bool, flag("--stiff", "Links that hardly bend, and a slow motion.")] = False,
    mechanism: Annotated[str | None, typer.Option(help=f"Instead of an arm: {_KINDS}.")] = None,
) -> None:
    """Write a commented arm and scenario to start from: arm.yaml and scenario.yaml."""
    from flexarm.base.writing.places import check_folder, write_text

    if mechanism is not None and mechanism not in MECHANISMS:
        raise InputError(Problem("--mechanism", f"be one of {_KINDS}", shown(mechanism)))
    if mechanism is not None and (links != 2 or gravity or stiff):
        raise InputError(
            Problem("--mechanism", "cannot be combined with --links, --gravity, --stiff")
        )
    arm, scenario = folder / "arm.yaml", folder / "scenario.yaml"
    hint = "Give another folder: flexarm init FOLDER."
    problems = [
        Problem(shown(str(path)), "already exists", hint=hint)
        for path in (arm, scenario)
        if os.path.lexists(path)
    ]
    raise_any(problems)
    check_folder("FOLDER", folder)
    texts = mechanism_files(mechanism) if mechanism else arm_files(links, gravity, stiff)
    for kind, path, text in zip(("arm", "scenario"), (arm, scenario), texts, strict=True):
        write_text(text, path)
        print_line(f"{kind} in {path}")
    print_line(f"next: flexarm check {_quoted(scenario)}")
    print_line(f"      flexarm run {_quoted(scenario)} --animate {_quoted(folder / 'arm.html')}")


def _quoted(path: Path) -> str:
    """Return a path as an argument of a command, in quotes if it contains spaces."""
    return f'"{path}"' if any(map(str.isspace, str(path))) else str(path)
