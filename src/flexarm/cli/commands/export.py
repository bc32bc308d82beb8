"""``flexarm export``: an arm, and the controller or the run of a scenario, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import flexarm as fa
from flexarm.base.errors import InputError, without_warnings
from flexarm.base.late import xr
from flexarm.cli.failures import report_failures, reported_warnings, warn
from flexarm.cli.options import (
    Angles,
    ArmFile,
    Inputs,
    Outputs,
    Parameters,
    argument,
    comma_separated,
    joint_numbers,
    option,
)
from flexarm.cli.tables import print_line

if TYPE_CHECKING:
    from flexarm.arm.assembly.assemble import FloatArray
    from flexarm.cases.scenario.scenario import Prepared

export = typer.Typer(help="Convert an arm for other programs.", no_args_is_help=True)

_Exported = Annotated[Path, argument("FILE", "Arm, or a scenario, whose controller is exported.")]
_Out = Annotated[Path | None, option("FILE", "The file; by default beside the arm's.")]
_VirtualJoints = Annotated[
    int, typer.Option(min=2, max=64, help="Virtual joints of each flexible link.")
]


@export.command("c")
@report_failures
def export_c(
    file: _Exported,
    out: Annotated[
        Path | None, option("DIR", "Folder; by default beside the file: FILE_c.")
    ] = None,
    name: Annotated[str, option("NAME", "Prefix of the functions and of the files.")] = "arm",
    parameters: Parameters = None,
    stations: Annotated[
        int, option("N", "Sections of each link whose stress becomes a function; 0: none.")
    ] = 0,
    detail_category: Annotated[
        float | None, option("PA", "Stress range of a detail: adds the damage; needs stations.")
    ] = None,
) -> None:
    """Write C code: dynamics, kinematics, a step with its derivative, the controller."""
    arm, controller, _ = _arm_and_controller(file)
    controller, observer = _separated(controller)
    folder = out or file.with_name(f"{file.stem}_c")
    options: dict[str, Any] = {"name": name, "parameters": parameters or []}
    options |= {"stations": stations, "detail_category": detail_category}
    with reported_warnings():
        files = fa.export_c(arm, folder, **options, controller=controller, observer=observer)
    for path in files:
        print_line(path)
    for kind, law in (("controller", controller), ("observer", observer)):
        if law is not None:
            print_line(f"with the {kind} {type(law).__name__}")
    print_line(f"next: make -C {folder} test")


@export.command("fmu")
@report_failures
def export_fmu(
    file: _Exported,
    out: Annotated[
        Path | None, option("FILE", "The file; by default beside the given one: FILE.fmu.")
    ] = None,
    fmi: Annotated[str, option("2.0|3.0", "Version of the standard.")] = "2.0",
    name: Annotated[str, option("NAME", "Identifier of the model and of its C functions.")] = "arm",
    parameters: Annotated[
        list[str] | None,
        option(
            "PATH",
            "A number that can be set before a run, such as payload.mass; repeatable.",
            "--parameter",
        ),
    ] = None,
) -> None:
    """Write an FMU for model exchange and co-simulation, with source and Linux binary."""
    arm, controller, (q, qd) = _arm_and_controller(file)
    options: dict[str, Any] = {"fmi": fmi, "name": name, "parameters": parameters or []}
    options |= {"controller": controller, "initial": q, "initial_rate": qd}
    with reported_warnings():
        written = fa.export_fmu(arm, out or file.with_suffix(".fmu"), **options)
    print_line(written)
    if controller is not None:
        print_line(f"with the controller {type(controller).__name__}")


@export.command("mat")
@report_failures
def export_mat(
    file: Annotated[Path, argument("FILE", "Arm; scenario, which is simulated; or result (.nc).")],
    out: Annotated[Path | None, option("FILE", "The .mat file; by default beside FILE.")] = None,
    angles: Angles = None,
    inputs: Inputs = "torque",
    outputs: Outputs = "joint_angle,tip",
    parameters: Parameters = None,
) -> None:
    """Write MATLAB files: a linear model, the result of a run, a function of the dynamics."""
    from flexarm.arm.bending import bending_warning
    from flexarm.simulation.calls.compare import warnings_of

    with without_warnings():  # printed below in one line
        arm, result = _arm_and_result(file)
        rest = fa.equilibrium(arm, joint_numbers("--angles", arm, angles, "rad"))
        signals = comma_separated(inputs), comma_separated(outputs)
        linear = fa.linearize(arm, rest, inputs=signals[0], outputs=signals[1])
    place = out or file.with_suffix(".mat")
    files = fa.export_mat(arm, place, linear=linear, result=result, parameters=parameters or [])
    texts = [bending_warning(arm, rest.q), *([] if result is None else warnings_of(result))]
    for text in filter(None, texts):
        warn(text)
    for path in files:
        print_line(path)


def _add_chain_command(kind: str, suffix: str, product: str) -> None:
    """Add the command that writes an arm as a chain of rigid bodies for another program."""

    def command(arm: ArmFile, out: _Out = None, virtual_joints: _VirtualJoints = 4) -> None:
        place, write = out or arm.with_suffix(suffix), getattr(fa, f"export_{kind}")
        print_line(write(fa.load_arm(arm), place, virtual_joints=virtual_joints))

    command.__name__ = f"export_{kind}"
    command.__doc__ = f"Write {product}: links as rigid bars on virtual joints."
    export.command(kind)(report_failures(command))


_add_chain_command("mjcf", ".xml", "a model of MuJoCo")
_add_chain_command("urdf", ".urdf", "a robot in URDF")
_add_chain_command("exudyn", ".py", "a Python script for Exudyn")


def _separated(controller: fa.Controller | None) -> tuple[fa.Controller | None, Any]:
    """Return a controller and its filter, which are two functions in C."""
    from flexarm.control.filters.estimator_controller import EstimatorController

    if not isinstance(controller, EstimatorController):
        return controller, None
    controller.reset()  # which gives the filter the sample time of the controller
    return controller.inner, controller.estimator


def _arm_and_controller(path: Path) -> tuple[fa.Arm, fa.Controller | None, FloatArray]:
    """Return the arm of a file, the controller of a scenario, and the initial q and qd."""
    import numpy as np

    from flexarm.simulation.calls.preparation import start_of

    prepared = _described(path)
    if isinstance(prepared, fa.Arm):
        return prepared, None, np.zeros((2, prepared.dof))
    arm, options = prepared.arm, prepared.options
    names = ("initial", "initial_rate", "reference", "torque")
    state = start_of(arm, *(options.get(name) for name in names))
    return arm, options.get("controller"), state.reshape(2, -1)[:, arm.assembly.coordinates]


def _arm_and_result(path: Path) -> tuple[fa.Arm, xr.Dataset | None]:
    """Return the arm of a file, and the result of a scenario or of a result file."""
    from flexarm.simulation.calls.result import arm_of

    if path.suffix.lower() == ".nc":
        result = fa.read_result(path)
        try:
            return arm_of("the file", result), result
        except InputError as error:
            raise error.at(str(path)) from None
    prepared = _described(path)
    if isinstance(prepared, fa.Arm):
        return prepared, None
    return prepared.arm, prepared.run()


def _described(path: Path) -> fa.Arm | Prepared:
    """Return the arm of a file, or its scenario, ready to run."""
    from flexarm.arm.arm import described_arm
    from flexarm.cases.scenario.scenario import prepare
    from flexarm.model import load_arm_spec, locate_scenario
    from flexarm.model.file_format.files import describes_arm_only, load_document

    document = load_document(path)
    if describes_arm_only(document):
        return described_arm(load_arm_spec(document))
    return prepare(*locate_scenario(document))
