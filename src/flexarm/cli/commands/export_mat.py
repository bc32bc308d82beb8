"""``flexarm export mat``: an arm, or a run with its arm, for MATLAB and GNU Octave."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from flexarm.arm.arm import Arm, described_arm
from flexarm.arm.bending import bending_warning
from flexarm.base.errors import FlexarmWarning, InputError
from flexarm.bridges.matlab.export import export_mat
from flexarm.cases.results import read_result
from flexarm.cases.scenario.scenario import prepare
from flexarm.cli.failures import warn
from flexarm.cli.postures import comma_separated, joint_numbers
from flexarm.cli.tables import console
from flexarm.linear import equilibrium, linearize
from flexarm.model import load_arm_spec, locate_scenario
from flexarm.model.file_format.files import describes_arm_only, load_document
from flexarm.simulation.calls.compare import warnings_of
from flexarm.view.plot.drawn_arm import arm_of

if TYPE_CHECKING:
    import xarray as xr


def export_mat_file(
    path: Path,
    out: Path | None,
    angles: str | None,
    inputs: str,
    outputs: str,
    parameters: list[str],
) -> None:
    """Write an arm file, a scenario file, which is simulated, or a result file for MATLAB.

    Raises:
        InputError: if the file is not valid, or under the conditions of ``export_mat``.
        EquilibriumError: if the arm has no equilibrium at the angles.
        SimulationError: if the run of a scenario stops early.
    """
    with warnings.catch_warnings():  # printed below in one line
        warnings.simplefilter("ignore", FlexarmWarning)
        arm, result = _arm_and_result(path)
        rest = equilibrium(arm, joint_numbers("--angles", arm, angles, "rad"))
        signals = comma_separated(inputs), comma_separated(outputs)
        linear = linearize(arm, rest, inputs=signals[0], outputs=signals[1])
    place = out if out is not None else path.with_suffix(".mat")
    files = export_mat(arm, place, linear=linear, result=result, parameters=parameters)
    found = [bending_warning(arm, rest.q), *([] if result is None else warnings_of(result))]
    for text in filter(None, found):
        warn(text)
    for file in files:
        console().print(str(file), soft_wrap=True)


def _arm_and_result(path: Path) -> tuple[Arm, xr.Dataset | None]:
    """Return the arm of a file, and the result of a scenario or of a result file."""
    if path.suffix.lower() == ".nc":
        result = read_result(path)
        try:
            return arm_of("the file", result), result
        except InputError as error:
            raise error.at(str(path)) from None
    document = load_document(path)
    if describes_arm_only(document):
        return described_arm(load_arm_spec(document)), None
    prepared = prepare(*locate_scenario(document))
    return prepared.arm, prepared.run()
