"""Options that several commands have, and the conversion of their texts."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from flexarm.base.errors import InputError, Problem, shown

if TYPE_CHECKING:
    from flexarm.arm.arm import Arm
    from flexarm.model.file_format.yaml_text import Document

#: Placeholder of a list in the help.
LIST = '"A,B,..."'


def argument(placeholder: str, text: str) -> Any:
    """Return an argument of a command, with its help."""
    return typer.Argument(metavar=placeholder, help=text)


def option(placeholder: str, text: str, name: str = "") -> Any:
    """Return an option with a value, with its help; by default named like its parameter."""
    return typer.Option(*filter(None, [name]), metavar=placeholder, help=text)


def flag(name: str, text: str) -> Any:
    """Return an option without a value, with its help."""
    return typer.Option(name, help=text)


ArmFile = Annotated[Path, argument("ARM.yaml", "Arm or scenario.")]
Plot = Annotated[Path | None, option("FILE", "Save a plot: .png, .pdf or .svg.")]
Angles = Annotated[
    str | None, option(LIST, "Joint angles of the equilibrium, rad; zero by default.")
]
Inputs = Annotated[str, option(LIST, "Inputs, such as torque, tip_force.")]
Outputs = Annotated[str, option(LIST, "Outputs, such as joint_angle, tip, strain.")]
Parameters = Annotated[
    list[str] | None,
    option(
        "PATH",
        "A number that becomes an argument, such as payload.mass; repeatable.",
        "--parameter",
    ),
]
Workers = Annotated[
    int | None, typer.Option(metavar="N", min=1, help="Processes; by default one for each core.")
]
Limits = Annotated[
    list[str] | None,
    option(
        "NAME=VALUE",
        "A run above it, such as tip_error_peak=0.01, counts as failed; repeatable.",
        "--limit",
    ),
]
Sets = Annotated[
    list[str] | None,
    option(
        "PATH=VALUE",
        "Change a value of the file, such as arm.links[0].length=1.2; repeatable.",
        "--set",
    ),
]


def changed_document(path: Path, sets: Sequence[str] | None) -> Document:
    """Return the content of a file with the values of ``--set`` in place of its own."""
    from flexarm.model.file_format.files import load_document
    from flexarm.model.file_format.yaml_text import change_of, changed

    changes = [change_of("--set", text) for text in sets or ()]
    return changed(load_document(path), changes)


def check_places(*places: tuple[str, Path | None, Collection[str]]) -> None:
    """Check that files can be written: option, path, and allowed suffixes of each."""
    from flexarm.base.writing.places import check_place

    for name, path, suffixes in places:
        if path is not None:
            check_place(name, path, suffixes)


def comma_separated(text: str) -> list[str]:
    """Return the names in a text, which commas separate."""
    return [name.strip() for name in text.split(",") if name.strip()]


def joint_numbers(name: str, arm: Arm, text: str | None, unit: str) -> list[float]:
    """Parse one finite number for each joint, separated by commas; return zeros for None."""
    if text is None:
        return [0.0] * arm.n_joints
    try:
        values = [float(number) for number in text.split(",")]
    except ValueError:
        values = []
    if not arm.n_joints:
        raise InputError(Problem(name, "is not supported for an arm whose joints are all fixed"))
    if len(values) != arm.n_joints or not all(math.isfinite(value) for value in values):
        rule = f"be {arm.n_joints} numbers separated by commas, one for each joint ({unit})"
        raise InputError(Problem(name, rule, shown(text)))
    return values


def listed(angles: Sequence[float]) -> str:
    """Format angles as text, at most the first eight."""
    more = ", ..." if len(angles) > 8 else ""
    return ", ".join(f"{angle:.4g}" for angle in angles[:8]) + more
