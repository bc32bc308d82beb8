"""Export for MATLAB and GNU Octave."""

from __future__ import annotations

import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_dataset, check_kind
from flexarm.base.errors import public_call
from flexarm.base.writing.mat_file import mat_bytes
from flexarm.base.writing.places import check_place, write_text, write_whole
from flexarm.bridges.symbolic.casadi_model import exported_model
from flexarm.linear import LinearModel, linearize

if TYPE_CHECKING:
    import xarray as xr

#: Longest name of a function in MATLAB.
_LONGEST = 63
_ENDING = "_dynamics"


@public_call
def export_mat(
    arm: Arm,
    path: str | PathLike[str],
    *,
    linear: LinearModel | None = None,
    result: xr.Dataset | None = None,
    parameters: Sequence[str] = (),
) -> list[Path]:
    """Write an arm for MATLAB and GNU Octave: a linear model, a result, and the dynamics.

    ``arm.mat`` contains the structures ``linear``, with the names of ``save_linear``, and
    ``result``, with the channels, their ``units`` and ``attributes``. ``arm_dynamics.m`` beside it
    is the function ``qdd = arm_dynamics(q, qd, torque, tip_force, parameters)``, which needs no
    toolbox. Both are replaced if they exist.

    Args:
        arm: the arm.
        path: the ``.mat`` file. In the name of the function, ``_`` replaces the characters that
            are not possible there.
        linear: linear model; by default that of ``linearize`` with the joints at rest at zero, and
            joint angles and tip as outputs.
        result: result of ``simulate``.
        parameters: paths of numbers that become an argument of the function, as in ``to_casadi``.

    Returns:
        The files.

    Raises:
        InputError: if CasADi is not installed, a parameter is not possible, an argument has a wrong
            type, or a file cannot be written.
        EquilibriumError: if ``linear`` is None and the arm has no equilibrium at zero.

    Warns:
        LargeDeflectionWarning: as in ``linearize``, if ``linear`` is None.
        AccuracyWarning: as in ``to_casadi``.
    """
    from flexarm.bridges.matlab.dynamics_file import dynamics_file
    from flexarm.bridges.matlab.result_structure import result_structure

    model = exported_model(arm, parameters)
    place = check_place("path", path, (".mat",))
    name = _function_name(place.stem)
    script = place.with_name(f"{name}.m")
    if linear is None:
        linear = linearize(arm, outputs=("joint_angle", "tip"))
    check_kind("linear", linear, LinearModel, hint="fa.linearize returns one.")
    variables: dict[str, Any] = {"linear": linear.arrays()}
    if result is not None:
        variables["result"] = result_structure(check_dataset("result", result))
    write_text(dynamics_file(model, name), script)
    write_whole(place, [mat_bytes(variables)])
    return [place, script]


def _function_name(stem: str) -> str:
    """Return the name of the function for the file name ``stem``."""
    plain = re.sub(r"\W", "_", stem, flags=re.ASCII)
    first = plain if plain[:1].isalpha() else f"arm_{plain}"
    return first[: _LONGEST - len(_ENDING)] + _ENDING
