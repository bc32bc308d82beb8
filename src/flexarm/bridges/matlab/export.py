"""Export for MATLAB and GNU Octave."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from importlib.metadata import version
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_dataset, check_kind
from flexarm.base.errors import public_call
from flexarm.base.late import xr
from flexarm.base.writing.mat_file import mat_bytes
from flexarm.base.writing.places import check_place, write_text, write_whole
from flexarm.bridges.symbolic.models import CasadiModel, exported_model
from flexarm.linear import LinearModel, linearize
from flexarm.linear.models.state_space import state_names

if TYPE_CHECKING:
    import casadi


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
    model = exported_model(arm, parameters)
    place = check_place("path", path, (".mat",))
    plain = re.sub(r"\W", "_", place.stem, flags=re.ASCII)
    first = plain if plain[:1].isalpha() else f"arm_{plain}"
    name = first[: _LONGEST - len(_ENDING)] + _ENDING
    script = place.with_name(f"{name}.m")
    if linear is None:
        linear = linearize(arm, outputs=("joint_angle", "tip"))
    check_kind("linear", linear, LinearModel, hint="fa.linearize returns one.")
    variables: dict[str, Any] = {"linear": linear.arrays()}
    if result is not None:
        variables["result"] = _result_structure(check_dataset("result", result))
    function = model.forward_dynamics
    given = [one for one in function.name_in() if one != "parameters" or model.parameters]
    sizes = {one: function.size1_in(one) for one in given}
    lines = [f"function qdd = {name}({', '.join(given)})", *_help(model, name), ""]
    lines += ["if nargin < 4, tip_force = zeros(3, 1); end"]
    if model.parameters:
        nominal = "; ".join(map(repr, model.nominal.tolist()))
        lines += ["if nargin < 5", f"    parameters = [{nominal}];", "end"]
    wrong = " || ".join(f"size({one}, 1) ~= {size}" for one, size in sizes.items())
    rows = ", ".join(f"{size} of {one}" for one, size in sizes.items())
    lines += [f"if {wrong}", f"    error('{name}:size', 'The rows must be {rows}.')", "end"]
    columns = ", ".join(f"size({one}, 2)" for one in given)
    lines += [f"qdd = zeros({sizes['q']}, max([{columns}]));"]
    write_text("\n".join([*lines, *statements(function), "end", ""]), script)
    write_whole(place, [mat_bytes(variables)])
    return [place, script]


def _help(model: CasadiModel, name: str) -> list[str]:
    """Return the comment that ``help`` prints."""
    arm, programs = model.arm, f"flexarm {version('flexarm')} with CasADi {version('casadi')}"
    names, units = state_names(arm)
    coordinates = list(zip(names[: arm.dof], units, strict=False))
    lines = [
        f"{name.upper()}  Accelerations of a planar arm with flexible links.",
        "  q, qd      coordinates and their rates, listed below",
        f"  torque     torque of each joint, N m, {arm.n_joints} rows",
        "  tip_force  Fx, Fy (N) and Mz (N m) on the last tip in world axes; optional",
    ]
    if model.parameters:
        lines += ["  parameters  listed below, in the units of the file; optional"]
    lines += ["", "Each argument has one column, or one column for each of many states.", ""]
    lines += [f"  q({k})  {label}, {unit}" for k, (label, unit) in enumerate(coordinates, 1)]
    lines += [f"  parameters({k})  {path}" for k, path in enumerate(model.parameters, 1)]
    lines += ["", f"Generated by {programs}; do not edit."]
    return [f"%{line}" if k == 0 else f"% {line}".rstrip() for k, line in enumerate(lines)]


def _result_structure(result: xr.Dataset) -> dict[str, Any]:
    """Return channels and coordinates by name, ``units`` and ``attributes``."""
    # Arrays keep the order of their dimensions. Integers become floating-point numbers, because in
    # MATLAB arithmetic with integers rounds; texts become cell arrays.
    arrays = {str(name): array for name, array in result.variables.items()}
    structure: dict[str, Any] = {name: _numbers(array.values) for name, array in arrays.items()}
    structure["units"] = {name: str(array.attrs.get("units", "")) for name, array in arrays.items()}
    structure["attributes"] = {
        str(name): _numbers(np.asarray(value)) for name, value in result.attrs.items()
    }
    return structure


def _numbers(values: np.ndarray[Any, Any]) -> Any:
    if values.dtype.kind in "iu":
        return values.astype(np.float64)
    return values.tolist() if values.dtype.kind in "OUST" else values


#: Operations of one operand with the names of MATLAB.
_SAME_NAMES = "SQRT EXP EXPM1 LOG LOG1P SIN COS TAN ATAN SINH COSH TANH SIGN"
#: Expressions of CasADi's operations in terms of their operands.
EXPRESSIONS = {
    "ASSIGN": "{0}",
    "ADD": "{0} + {1}",
    "SUB": "{0} - {1}",
    "MUL": "{0} .* {1}",
    "DIV": "{0} ./ {1}",
    "NEG": "-{0}",
    "INV": "1 ./ {0}",
    "SQ": "{0} .* {0}",
    "TWICE": "2 * {0}",
    "POW": "{0} .^ {1}",
    "CONSTPOW": "{0} .^ {1}",
    **{name: f"{name.lower()}({{0}})" for name in _SAME_NAMES.split()},
    "FABS": "abs({0})",
    "ATAN2": "atan2({0}, {1})",
    "FMIN": "min({0}, {1})",
    "FMAX": "max({0}, {1})",
}


def statements(function: casadi.Function) -> Iterator[str]:
    """Yield the statements that compute the outputs, columns that exist, from the inputs.

    CasADi has no generator for MATLAB code. Its functions of type SX are lists of elementary
    operations on a work vector, which are written here one by one. The entries of the work vector
    are variables, and the operators act on rows: a call evaluates many columns at once.
    """
    import casadi

    expressions = {getattr(casadi, f"OP_{name}"): text for name, text in EXPRESSIONS.items()}
    given, results = function.name_in(), function.name_out()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == casadi.OP_OUTPUT:
            yield f"{results[target[0]]}({target[1] + 1}, :) = w{source[0]};"
            continue
        if operation == casadi.OP_CONST:
            value = repr(function.instruction_constant(k))
        elif operation == casadi.OP_INPUT:
            value = f"{given[source[0]]}({source[1] + 1}, :)"
        elif operation in expressions:
            value = expressions[operation].format(*(f"w{one}" for one in source))
        else:
            raise NotImplementedError(f"operation {operation} of CasADi in MATLAB")
        yield f"w{target[0]} = {value};"
