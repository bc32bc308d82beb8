"""Command ``flexarm design`` with options and help; see `flexarm.cli.main`."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from flexarm.cli.failures import report_failures


class Task(StrEnum):
    """Tasks of a controller."""

    HOLD = "hold"
    POINT_TO_POINT = "point_to_point"
    TRACK = "track"
    FORCE = "force"


class Computing(StrEnum):
    """Computing power for a controller."""

    LOW = "low"
    MEDIUM = "medium"
    HIGH = "high"


_Place = typer.Option(
    metavar='"A,B,..."', help="Joint angles, rad, or for track and force the tip x,y, m."
)


@report_failures
def design(
    arm: Annotated[Path, typer.Argument(metavar="ARM.yaml", help="Arm or scenario.")],
    task: Annotated[Task, typer.Option(help="Task of the controller.")],
    sensors: Annotated[
        str | None,
        typer.Option(
            metavar='"A,B,..."',
            help="joints, gauges, tip, force; by default joints and the gauges of the arm.",
        ),
    ] = None,
    computing: Annotated[
        Computing, typer.Option(help="Computing power for one sample.")
    ] = Computing.MEDIUM,
    payload_uncertainty: Annotated[
        float, typer.Option(metavar="FRACTION", help="Largest relative error of the payload.")
    ] = 0.0,
    rigidity_uncertainty: Annotated[
        float, typer.Option(metavar="FRACTION", help="Largest relative error of the rigidity.")
    ] = 0.0,
    start: Annotated[str | None, _Place] = None,
    end: Annotated[str | None, _Place] = None,
    duration: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS", help="Of the motion; by default 2.5 periods of the lowest mode."
        ),
    ] = None,
    torque_limit: Annotated[
        str | None,
        typer.Option(
            metavar='"A,B,..."',
            help="Limits of the motors, N m, one for all joints or one for each.",
        ),
    ] = None,
    force: Annotated[
        float, typer.Option(metavar="NEWTONS", help="Force on the surface (task force).")
    ] = 5.0,
    disk_margin: Annotated[
        float, typer.Option(metavar="ALPHA", help="Required disk margin on all arms.")
    ] = 0.4,
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="Scenario file to write: .yaml.")
    ] = Path("design.yaml"),
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the file if it exists.")
    ] = False,
) -> None:
    """Propose a controller for a task, with its margins, and write its scenario."""
    from flexarm.cli.proposal import design_file

    options = {
        "sensors": sensors,
        "computing": computing.value,
        "payload_uncertainty": payload_uncertainty,
        "rigidity_uncertainty": rigidity_uncertainty,
        "start": start,
        "end": end,
        "duration": duration,
        "torque_limit": torque_limit,
        "force": force,
        "disk_margin": disk_margin,
    }
    design_file(arm, task.value, options, out, overwrite=overwrite)
