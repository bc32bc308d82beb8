"""Export of functional mock-up units (FMI 2.0 and 3.0)."""

from __future__ import annotations

import hashlib
import io
import uuid
import zipfile
from collections.abc import Sequence
from dataclasses import replace
from importlib.resources import files
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_choice
from flexarm.base.errors import FlexarmWarning, InputError, Problem, public_call, shown, warn_caller
from flexarm.base.writing.places import check_place, write_whole
from flexarm.bridges.c_code.export import check_prefix, exported
from flexarm.bridges.fmu.binary import compiled
from flexarm.bridges.symbolic.casadi_model import exported_model
from flexarm.control.contract.base import Controller, check_controller
from flexarm.simulation.run.new_run import initial_state

if TYPE_CHECKING:
    from flexarm.bridges.c_code.exported import Exported
    from flexarm.bridges.fmu.variables import Variables

#: Functions of the exported code in an FMU.
_FUNCTIONS = ("forward_dynamics", "tip", "tip_velocity", "strain", "energy")
#: Proposed communication step of an arm without controller, s.
_STEP = 1e-3
#: Time of all files in the archive, so that equal exports are equal files.
_TIME = (1980, 1, 1, 0, 0, 0)


@public_call
def export_fmu(
    arm: Arm,
    path: str | PathLike[str],
    *,
    fmi: str = "2.0",
    name: str = "arm",
    parameters: Sequence[str] = (),
    controller: Controller | None = None,
    initial: ArrayLike | None = None,
    initial_rate: ArrayLike | None = None,
) -> Path:
    """Write an arm, and optionally a controller, as a functional mock-up unit (FMU).

    It contains the code of ``export_c`` for model exchange and co-simulation, and on Linux its
    binary. Inputs are the torques and a force on the tip; with a controller the reference instead
    of the torques. Names and units are those of results. Co-simulation integrates with the method
    and the tolerances of ``dormand_prince_8``.

    Args:
        arm: the arm.
        path: the file, ``.fmu``.
        fmi: version of the standard, "2.0" or "3.0".
        name: identifier of the model: lower-case letters, digits and underscores.
        parameters: paths of numbers that can be set before a run, as in ``to_casadi``.
        controller: a controller that ``export_c`` accepts.
        initial: q (dof,) at the start, by default straight links and joint angles zero; it can be
            set in the FMU, too.
        initial_rate: qd (dof,), zero by default.

    Returns:
        The file.

    Warns:
        FlexarmWarning: if there is no C compiler; the FMU then contains the source only.
        AccuracyWarning: as in ``to_casadi``.

    Raises:
        InputError: if CasADi is not installed; an argument is not valid, as in ``export_c``; or the
            file cannot be written.
    """
    model = exported_model(arm, parameters)
    version = check_choice("fmi", fmi, ("2.0", "3.0"))
    prefix = check_prefix("name", name)
    if prefix.startswith(("fmi", "fmu")):
        raise InputError(Problem("name", "not start with fmi or fmu", shown(name)))
    if controller is not None:
        check_controller("controller", controller)
    state = initial_state(arm, initial, initial_rate, np.zeros(arm.joints))
    q, qd = state.reshape(2, -1)[:, arm.assembly.coordinates]
    whole = exported(model, prefix, controller)
    export = replace(whole, functions=[f for f in whole.functions if f.name in _FUNCTIONS])
    place = check_place("path", path, (".fmu",))

    from flexarm.bridges.fmu.variables import Variables

    variables = Variables(export, q, qd)
    write_whole(place, [_archive(export, variables, version)])
    return place


def _archive(export: Exported, variables: Variables, fmi: str) -> bytes:
    from flexarm.bridges.c_code.header import header
    from flexarm.bridges.c_code.source import source
    from flexarm.bridges.fmu.description import build_description, model_description
    from flexarm.bridges.fmu.glue import model_header

    name, glue = export.name, f"fmi{fmi[0]}"
    own = files("flexarm.bridges.fmu") / "c"
    texts = {
        file: (own / file).read_text(encoding="utf-8")
        for file in ("fmu_core.h", f"{glue}_interface.h", f"{glue}.c")
    }
    texts |= {f"{name}.h": header(export), f"{name}.c": source(export)}
    # Equations and start values identify the FMU.
    whole = "".join([*texts.values(), model_header(export, variables, ""), repr(variables.all)])
    token = "{" + str(uuid.UUID(hashlib.sha256(whole.encode()).hexdigest()[:32])) + "}"
    texts["fmu_model.h"] = model_header(export, variables, token)
    sources = [f"{name}.c", f"{glue}.c"]
    step = export.controller.sample_time if export.controller else _STEP
    described = model_description(fmi, name, token, sources, variables.all, step)
    content = {"modelDescription.xml": described}
    content |= {f"sources/{file}": text.encode() for file, text in texts.items()}
    if fmi == "3.0":
        content["sources/buildDescription.xml"] = build_description(name, sources)
    try:
        file, library = compiled(fmi, name, texts, sources)
        content[file] = library
    except OSError as reason:
        hint = "Compile the FMU on the system that simulates it, for example with 'fmpy compile'."
        warn_caller(
            f"the FMU contains the source without a binary: {reason}. {hint}", FlexarmWarning
        )
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for entry, data in content.items():
            info = zipfile.ZipInfo(entry, _TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = (0o755 if entry.startswith("binaries/") else 0o644) << 16
            archive.writestr(info, data)
    return stream.getvalue()
