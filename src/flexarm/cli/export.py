"""Commands of ``flexarm export`` with options and help; see `flexarm.cli.main`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from flexarm.cli.failures import report_failures
from flexarm.cli.options import Angles, Inputs, Outputs, Parameters

export = typer.Typer(help="Convert an arm for other programs.", no_args_is_help=True)

_Exported = Annotated[
    Path, typer.Argument(metavar="FILE", help="Arm, or a scenario, whose controller is exported.")
]


@export.command("c")
@report_failures
def export_c(
    file: _Exported,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder; by default beside the file: FILE_c."),
    ] = None,
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Prefix of the functions and of the files.")
    ] = "arm",
    parameters: Parameters = None,
) -> None:
    """Write C code: dynamics, kinematics, a step with its derivative, the controller."""
    from flexarm.cli.commands.export import export_c_file

    export_c_file(file, out, name, parameters or [])


@export.command("fmu")
@report_failures
def export_fmu(
    file: _Exported,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The file; by default beside the given one: FILE.fmu."),
    ] = None,
    fmi: Annotated[str, typer.Option(metavar="2.0|3.0", help="Version of the standard.")] = "2.0",
    name: Annotated[
        str, typer.Option(metavar="NAME", help="Identifier of the model and of its C functions.")
    ] = "arm",
    parameters: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter",
            metavar="PATH",
            help="A number that can be set before a run, such as payload.mass; repeatable.",
        ),
    ] = None,
) -> None:
    """Write an FMU for model exchange and co-simulation, with source and Linux binary."""
    from flexarm.cli.commands.export import export_fmu_file

    export_fmu_file(file, out, fmi, name, parameters or [])


_ArmFile = Annotated[Path, typer.Argument(metavar="ARM.yaml", help="Arm or scenario.")]
_Out = Annotated[
    Path | None, typer.Option(metavar="FILE", help="The file; by default beside the arm's.")
]
_VirtualJoints = Annotated[
    int, typer.Option(min=2, max=64, help="Virtual joints of each flexible link.")
]


@export.command("mat")
@report_failures
def export_mat(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Arm; scenario, which is simulated; or result (.nc)."),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="The .mat file; by default beside FILE."),
    ] = None,
    angles: Angles = None,
    inputs: Inputs = "torque",
    outputs: Outputs = "joint_angle,tip",
    parameters: Parameters = None,
) -> None:
    """Write MATLAB files: a linear model, the result of a run, a function of the dynamics."""
    from flexarm.cli.commands.export_mat import export_mat_file

    export_mat_file(file, out, angles, inputs, outputs, parameters or [])


@export.command("mjcf")
@report_failures
def export_mjcf(arm: _ArmFile, out: _Out = None, virtual_joints: _VirtualJoints = 4) -> None:
    """Write a model of MuJoCo: links as rigid bars on virtual joints."""
    from flexarm.cli.commands.export import export_chain_file

    export_chain_file(arm, out, virtual_joints, "xml")


@export.command("urdf")
@report_failures
def export_urdf(arm: _ArmFile, out: _Out = None, virtual_joints: _VirtualJoints = 4) -> None:
    """Write a robot in URDF: links as rigid bars on virtual joints."""
    from flexarm.cli.commands.export import export_chain_file

    export_chain_file(arm, out, virtual_joints, "urdf")


@export.command("exudyn")
@report_failures
def export_exudyn(arm: _ArmFile, out: _Out = None, virtual_joints: _VirtualJoints = 4) -> None:
    """Write a Python script for Exudyn: links as rigid bars on virtual joints."""
    from flexarm.cli.commands.export import export_chain_file

    export_chain_file(arm, out, virtual_joints, "py")
