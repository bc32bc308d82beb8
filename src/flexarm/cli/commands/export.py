"""``flexarm export``: an arm, and the controller of a scenario, for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm, described_arm, load_arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.bridges.c_code.export import export_c
from flexarm.bridges.fmu.export import export_fmu
from flexarm.bridges.rigid_chain.export import (
    export_exudyn,
    export_mjcf,
    export_urdf,
)
from flexarm.cases.scenario.scenario import prepare
from flexarm.cli.failures import collected_warnings, warn
from flexarm.cli.tables import console
from flexarm.control.contract.base import Controller
from flexarm.control.filters.estimator_controller import EstimatorController
from flexarm.model import load_arm_spec, locate_scenario
from flexarm.model.file_format.files import describes_arm_only, load_document
from flexarm.simulation.calls.preparation import start_of

#: Exports as chains of rigid bodies, by the suffix of their files.
_CHAINS = {"xml": export_mjcf, "urdf": export_urdf, "py": export_exudyn}


def export_c_file(path: Path, out: Path | None, name: str, parameters: list[str]) -> None:
    """Write C code for an arm file, or for arm, controller and filter of a scenario file.

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_c``.
    """
    arm, controller, _ = _arm_and_controller(path)
    controller, observer = _separated(controller)
    folder = out if out is not None else path.with_name(f"{path.stem}_c")
    options: dict[str, Any] = {"name": name, "parameters": parameters}
    with collected_warnings() as found:
        files = export_c(arm, folder, **options, controller=controller, observer=observer)
    for text in found:
        warn(text)
    screen = console()
    for file in files:
        screen.print(str(file), soft_wrap=True)
    for kind, one in (("controller", controller), ("observer", observer)):
        if one is not None:
            screen.print(f"with the {kind} {type(one).__name__}", soft_wrap=True)
    screen.print(f"next: make -C {folder} test", soft_wrap=True)


def export_fmu_file(
    path: Path, out: Path | None, fmi: str, name: str, parameters: list[str]
) -> None:
    """Write an FMU of an arm file, or of the arm and the controller of a scenario file.

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_fmu``.
    """
    arm, controller, (q, qd) = _arm_and_controller(path)
    place = out if out is not None else path.with_suffix(".fmu")
    options: dict[str, Any] = {"fmi": fmi, "name": name, "parameters": parameters}
    with collected_warnings() as found:
        written = export_fmu(
            arm, place, **options, controller=controller, initial=q, initial_rate=qd
        )
    for text in found:
        warn(text)
    screen = console()
    screen.print(str(written), soft_wrap=True)
    if controller is not None:
        screen.print(f"with the controller {type(controller).__name__}", soft_wrap=True)


def export_chain_file(path: Path, out: Path | None, virtual_joints: int, suffix: str) -> None:
    """Write an arm file for a simulator of rigid bodies; ``suffix`` is one of `_CHAINS`.

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_mjcf``.
    """
    place = out if out is not None else path.with_suffix(f".{suffix}")
    written = _CHAINS[suffix](load_arm(path), place, virtual_joints=virtual_joints)
    console().print(str(written), soft_wrap=True)


def _separated(controller: Controller | None) -> tuple[Controller | None, Any]:
    """Return a controller and its filter, which are two functions in C."""
    if not isinstance(controller, EstimatorController):
        return controller, None
    controller.reset()  # which gives the filter the sample time of the controller
    return controller.inner, controller.estimator


def _arm_and_controller(path: Path) -> tuple[Arm, Controller | None, FloatArray]:
    """Return the arm of a file, the controller of a scenario, and the initial q and qd."""
    document = load_document(path)
    if describes_arm_only(document):
        arm = described_arm(load_arm_spec(document))
        return arm, None, np.zeros((2, arm.dof))
    prepared = prepare(*locate_scenario(document))
    arm, options = prepared.arm, prepared.options
    names = ("initial", "initial_rate", "reference", "torque")
    state = start_of(arm, *(options.get(name) for name in names))
    return arm, options.get("controller"), state.reshape(2, -1)[:, arm.assembly.coordinates]
