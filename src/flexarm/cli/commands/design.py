"""``flexarm design``: propose a controller, print its candidates, and write its scenario."""

from __future__ import annotations

import textwrap
from math import isfinite, pi
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

import flexarm as fa
from flexarm.base.errors import InputError, Problem, UnstableLoopWarning, shown, without_warnings
from flexarm.cli.failures import FAILED_RUN, print_error
from flexarm.cli.options import LIST, ArmFile, comma_separated, flag, option
from flexarm.cli.tables import console, numbers, print_line

#: Columns of the margins: variable, heading, factor to the displayed unit.
_MARGINS = (
    ("disk_margin", "disk", 1.0),
    ("gain_margin", "gain", 1.0),
    ("phase_margin", "phase °", 180.0 / pi),
    ("delay_margin", "delay ms", 1e3),
    ("growth", "growth", 1.0),
    ("damping_ratio", "damping", 1.0),
    ("states", "states", 1.0),
)
_WIDTH = 78


Task = Literal["hold", "point_to_point", "track", "force"]
Computing = Literal["low", "medium", "high"]
_Place = option(LIST, "Joint angles, rad, or for track and force the tip x,y, m.")


def design(
    arm: ArmFile,
    task: Annotated[Task, typer.Option(help="Task of the controller.")],
    sensors: Annotated[
        str | None,
        option(LIST, "joints, gauges, tip, force; by default joints and the gauges of the arm."),
    ] = None,
    computing: Annotated[
        Computing, typer.Option(help="Computing power for one sample.")
    ] = "medium",
    payload_uncertainty: Annotated[
        float, option("FRACTION", "Largest relative error of the payload.")
    ] = 0.0,
    rigidity_uncertainty: Annotated[
        float, option("FRACTION", "Largest relative error of the rigidity.")
    ] = 0.0,
    start: Annotated[str | None, _Place] = None,
    end: Annotated[str | None, _Place] = None,
    duration: Annotated[
        float | None,
        option("SECONDS", "Of the motion; by default 2.5 periods of the lowest mode."),
    ] = None,
    torque_limit: Annotated[
        str | None,
        option(LIST, "Limits of the motors, N m, one for all joints or one for each."),
    ] = None,
    hardware: Annotated[
        Path | None,
        option("FILE", "Instruments and motors: a file with hardware; by default a typical drive."),
    ] = None,
    force: Annotated[float, option("NEWTONS", "Force on the surface (task force).")] = 5.0,
    disk_margin: Annotated[float, option("ALPHA", "Required disk margin on all arms.")] = 0.4,
    out: Annotated[Path, option("FILE", "Scenario file to write: .yaml.")] = Path("design.yaml"),
    overwrite: Annotated[bool, flag("--overwrite", "Replace the file if it exists.")] = False,
) -> None:
    """Propose a controller for a task, with its margins, and write its scenario."""
    from flexarm.model.file_format.files import load_hardware
    from flexarm.planning.proposals import design as proposals

    loaded = fa.load_arm(arm)
    places = _numbers("--start", start), _numbers("--end", end)
    limits = _numbers("--torque-limit", torque_limit)
    options: dict[str, Any] = {
        "sensors": None if sensors is None else comma_separated(sensors),
        "computing": computing,
        "payload_uncertainty": payload_uncertainty,
        "rigidity_uncertainty": rigidity_uncertainty,
        "start": places[0],
        "end": places[1],
        "duration": duration,
        "torque_limit": limits[0] if limits and len(limits) == 1 else limits,  # for all joints
        "hardware": None if hardware is None else load_hardware(hardware),
        "force": force,
        "disk_margin": disk_margin,
    }
    hint = "Give another file with --out, or replace it with --overwrite."
    proposals.check_new("--out", out, overwrite=overwrite, hint=hint)
    with without_warnings(UnstableLoopWarning):  # the reasons have it
        proposal = proposals.design(loaded, task, **options)
    screen = console()
    screen.print(_errors_of(proposal))
    rows = []
    for name in proposal.table["candidate"].values:
        case = proposal.table.sel(candidate=name)
        values = (factor * float(case[variable]) for variable, _, factor in _MARGINS)
        rows.append([str(name), *(f"{value:.3g}" for value in values)])
    title = "Margins of the loop at each joint, the worst of all arms; growth in 1/s"
    screen.print(numbers(title, ["candidate", *(head for _, head, _ in _MARGINS)], rows))
    for text in proposal.reasons:
        print_line("\n".join(textwrap.wrap(text, _WIDTH)))
    if proposal.refusal:
        print_error("no candidate is accepted, so no scenario is written")
        raise typer.Exit(FAILED_RUN)
    proposal.save(out, overwrite=overwrite)
    print_line(f"scenario in {out}")


def _numbers(name: str, text: str | None) -> list[float] | None:
    """Return numbers that commas separate."""
    if text is None:
        return None
    try:
        return [float(number) for number in comma_separated(text)]
    except ValueError:
        raise InputError(Problem(name, "be numbers separated by commas", shown(text))) from None


def _errors_of(proposal: fa.ControllerDesign) -> object:
    """Return the table of the errors of all candidates on the simulated arms."""
    from flexarm.planning.proposals.candidates import NOT_SIMULATED
    from flexarm.simulation.calls.metrics import length_unit

    table = proposal.table
    largest = float(table["score"].max())
    pressed = proposal.task == "force"
    factor, unit = (1.0, "N") if pressed else length_unit(largest)
    rows = []
    for name in table["candidate"].values:
        case = table.sel(candidate=name)
        without = "refused" if NOT_SIMULATED in str(case["failure"].values[0]) else "failed"
        values = *(factor * case["score"].values), float(case["torque_peak"].max())
        cells = [f"{value:.3g}" if isfinite(value) else without for value in values]
        if pressed:
            tip = 1e3 * float(case["tip_error_settled"].max())
            cells.append(f"{tip:.3g}" if isfinite(tip) else without)
        rows.append([f"{name} *" if name == proposal.chosen else str(name), *cells])
    best = "the best one, which is refused" if proposal.refusal else "proposed"
    title = f"Task {proposal.task}: error in {unit} on each arm; * is {best}"
    heads = "candidate", *map(str, table["plant"].values), "peak N m", *["settled tip mm"] * pressed
    return numbers(title, heads, rows)
