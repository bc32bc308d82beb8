"""``flexarm design``: propose a controller, print its candidates, and write its scenario."""

from __future__ import annotations

import textwrap
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import typer

from flexarm.arm.arm import load_arm
from flexarm.base.errors import InputError, Problem, UnstableLoopWarning, shown
from flexarm.cli.failures import FAILED_RUN, print_error
from flexarm.cli.postures import comma_separated
from flexarm.cli.tables import console, numbers
from flexarm.planning.proposals.design import ControllerDesign, check_new, design

if TYPE_CHECKING:
    import xarray as xr

_NUMBERS = ("start", "end", "torque_limit")
#: Columns of the margins: variable, heading, factor to the displayed unit.
_MARGINS = (
    ("disk_margin", "disk", 1.0),
    ("gain_margin", "gain", 1.0),
    ("phase_margin", "phase °", 180.0 / np.pi),
    ("delay_margin", "delay ms", 1e3),
    ("growth", "growth", 1.0),
    ("damping_ratio", "damping", 1.0),
    ("states", "states", 1.0),
)
_WIDTH = 78


def design_file(
    path: Path, task: str, options: Mapping[str, Any], out: Path, *, overwrite: bool
) -> None:
    """Propose a controller for the arm in a file, and write its scenario.

    The output path is validated before the design.

    Args:
        options: those of `flexarm.design`; lists are text with commas.

    Raises:
        InputError: if the file or an option is not valid, or ``out`` exists or cannot be written.
        typer.Exit: with the status of a failed run, if the proposal is unstable. Then no file is
            written.
    """
    arm = load_arm(path)
    given = dict(options)
    if given["sensors"] is not None:
        given["sensors"] = comma_separated(given["sensors"])
    for name in _NUMBERS:
        given[name] = _numbers(f"--{name.replace('_', '-')}", given[name])
    limit = given["torque_limit"]
    if limit is not None and len(limit) == 1:
        given["torque_limit"] = limit[0]  # for all joints
    hint = "Give another file with --out, or replace it with --overwrite."
    check_new("--out", out, overwrite=overwrite, hint=hint)
    with warnings.catch_warnings():  # the reasons have it
        warnings.simplefilter("ignore", UnstableLoopWarning)
        found = design(arm, task, **given)
    screen = console()
    screen.print(_errors_of(found))
    screen.print(_margins_of(found.table))
    for text in found.reasons:
        screen.print("\n".join(textwrap.wrap(text, _WIDTH)), soft_wrap=True)
    if found.table["growth"].sel(candidate=found.chosen) > 0.0:
        print_error("no candidate is stable, so no scenario is written")
        raise typer.Exit(FAILED_RUN)
    found.save(out, overwrite=overwrite)
    screen.print(f"scenario in {out}", soft_wrap=True)


def _numbers(option: str, text: str | None) -> list[float] | None:
    """Return numbers that commas separate.

    Raises:
        InputError: if the text has something else.
    """
    if text is None:
        return None
    try:
        return [float(part) for part in comma_separated(text)]
    except ValueError:
        raise InputError(Problem(option, "be numbers separated by commas", shown(text))) from None


def _errors_of(found: ControllerDesign) -> object:
    """Return the table of the errors of all candidates on the simulated arms."""
    table, force = found.table, found.task == "force"
    factor, unit = (1.0, "N") if force else (1e3, "mm")
    rows = []
    for name in table["candidate"].values:
        one = table.sel(candidate=name)
        errors = [
            f"{factor * value:.3g}" if np.isfinite(value) else "failed"
            for value in one["score"].values
        ]
        cells = [*errors, f"{float(one['torque_peak'].max()):.3g}"]
        rows.append([f"{name} *" if name == found.chosen else str(name), *cells])
    title = f"Task {found.task}: error in {unit} on each arm; * is proposed"
    heads = ["candidate", *map(str, table["plant"].values), "peak N m"]
    return numbers(title, heads, rows)


def _margins_of(table: xr.Dataset) -> object:
    """Return the table of the margins of all candidates."""
    rows = []
    for name in table["candidate"].values:
        one = table.sel(candidate=name)
        values = (factor * float(one[variable]) for variable, _, factor in _MARGINS)
        rows.append([str(name), *(f"{value:.3g}" for value in values)])
    title = "Margins of the loop at each joint, the worst of all arms; growth in 1/s"
    return numbers(title, ["candidate", *(head for _, head, _ in _MARGINS)], rows)
