"""``flexarm export``: an arm, and the controller of a scenario, for other programs."""

from __future__ import annotations

from pathlib import Path

from flexarm.arm import Arm, load_arm
from flexarm.bridges.c_code.export import export_c
from flexarm.bridges.rigid_chain.export import export_mjcf, export_urdf
from flexarm.cli.tables import console
from flexarm.control.base import Controller
from flexarm.model import load_arm_spec, locate_scenario
from flexarm.model.file_format.files import describes_arm_only, load_document
from flexarm.scenarios.scenario import prepare


def export_c_file(path: Path, out: Path | None, name: str, parameters: list[str]) -> None:
    """Write C code for an arm file, or for the arm and the controller of a scenario file.

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_c``.
    """
    arm, controller = _arm_and_controller(path)
    folder = out if out is not None else path.with_name(f"{path.stem}_c")
    files = export_c(arm, folder, name=name, parameters=parameters, controller=controller)
    screen = console()
    for file in files:
        screen.print(str(file), soft_wrap=True)
    if controller is not None:
        screen.print(f"with the controller {type(controller).__name__}", soft_wrap=True)
    screen.print(f"next: make -C {folder} test", soft_wrap=True)


def export_chain_file(path: Path, out: Path | None, virtual_joints: int, suffix: str) -> None:
    """Write an arm file for a simulator of rigid bodies; ``suffix`` is "xml" or "urdf".

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_mjcf``.
    """
    export = export_mjcf if suffix == "xml" else export_urdf
    place = out if out is not None else path.with_suffix(f".{suffix}")
    written = export(load_arm(path), place, virtual_joints=virtual_joints)
    console().print(str(written), soft_wrap=True)


def _arm_and_controller(path: Path) -> tuple[Arm, Controller | None]:
    """Return the arm of a file, and its controller if it is a scenario with one."""
    document = load_document(path)
    if describes_arm_only(document):
        return Arm(load_arm_spec(document)), None
    prepared = prepare(*locate_scenario(document))
    return prepared.arm, prepared.options.get("controller")
