"""``fmu_model.h``: sizes, start values and equations of one arm for the C files of FMI."""

from __future__ import annotations

import numpy as np

from flexarm.bridges.c_code.exported import Exported, origin
from flexarm.bridges.c_code.named_function import NamedFunction
from flexarm.bridges.c_code.source import array
from flexarm.bridges.fmu.variables import OUTPUTS, Variables
from flexarm.integrate.explicit_runge_kutta.dormand_prince import DormandPrince8
from flexarm.simulation.run.tolerance import RTOL, absolute_tolerance

#: First step of co-simulation, as a part of the longest stable one.
_FIRST = 0.2


def model_header(export: Exported, variables: Variables, token: str) -> str:
    """Return the text of ``fmu_model.h``; ``token`` identifies the FMU."""
    places, sizes = variables.places, export.sizes
    share, reach = absolute_tolerance(export.arm, None, 1.0)
    macros = {
        "TOKEN": f'"{token}"',
        "DOF": sizes["DOF"],
        "VALUES": len(variables.all),
        "INPUT": places["tip_force"],
        "PARAMETER": places["parameters"],
        "OUTPUT": places["outputs"],
        "MEMORY": sizes.get("MEMORY", 0),
        "TOLERANCE": repr(RTOL),
        "ABSOLUTE": repr(share * reach),
        "FIRST_STEP": repr(_FIRST * export.largest_step),
    }
    if export.controller:
        macros["SAMPLE_TIME"] = repr(export.controller.sample_time)
    tableau = DormandPrince8().tableau
    stages = tableau.stages
    macros |= {"STAGES": stages, "ORDER": f"{float(tableau.order)!r}"}
    start = np.array([one.start or 0.0 for one in variables.all])
    static = "static const double fmu_"
    parts = [origin("fmu_model.h", "sizes and equations of the FMU") + " */"]
    parts += ["#ifndef FMU_MODEL_H", "#define FMU_MODEL_H", "", f'#include "{export.name}.h"', ""]
    parts += [f"#define FMU_{key} {value}" for key, value in macros.items()]
    parts += ["", array(f"{static}start", start)]
    parts += ["/* Coordinates and rates that move the tip by a metre. */"]
    parts += [array(f"{static}unit", variables.units.ravel())]
    parts += [
        f"/* Coefficients of {DormandPrince8.name}; the last row is that of the new point. */"
    ]
    parts += [array(f"{static}weights", tableau.A[: stages + 1, :stages])]
    parts += [array(f"{static}error_weights", tableau.error)]
    return "\n".join([*parts, _equations(export, places), "#endif", ""])


def _equations(export: Exported, places: dict[str, int]) -> str:
    functions = {function.name: function for function in export.functions}
    given = {name: f"v + {place}" for name, place in places.items()}
    moved = given | {"q": "q", "qd": "qd", "qdd": "qdd"}
    head = "double *v, const double *q, const double *qd, double *qdd"
    text = [
        f"static void fmu_accelerations({head})",
        "{",
        f"    {_call(export, functions['forward_dynamics'], moved)}",
        "}",
        "",
        "static void fmu_outputs(double *v)",
        "{",
        *(f"    {_call(export, functions[name], given)}" for name in OUTPUTS if name in functions),
        "}",
        "",
    ]
    return "\n".join(text + (_sample(export, given) if export.controller else []))


def _sample(export: Exported, given: dict[str, str]) -> list[str]:
    """Return the function that updates the controller."""
    assert export.controller is not None
    joints = export.arm.joint_index
    copies = []
    used = {name for function in export.controller.functions for name in function.inputs}
    for name, level in {"joint_angle": "q", "joint_rate": "qd"}.items():
        if name in used:
            values = ", ".join(f"({given[level]})[{k}]" for k in joints)
            copies.append(f"    const double {name}[{len(joints)}] = {{{values}}};")
            given = given | {name: name}
    given = given | {"memory": "memory"}
    *first, later = export.controller.functions
    lines = [f"    {_call(export, later, given)}"]
    if first:
        start = _call(export, first[0], given)
        lines = ["    if (first) {", f"        {start}", "    } else {", f"    {lines[0]}", "    }"]
    head = "static void fmu_sample(double *v, double *memory, int first)"
    return [head, "{", *copies, "    (void)memory;", "    (void)first;", *lines, "}", ""]


def _call(export: Exported, function: NamedFunction, given: dict[str, str]) -> str:
    """Return a call; an output is at the place of its name or of the function's."""
    inputs = [given[name] for name in function.inputs if name != "memory"]
    names = [name.removesuffix("_out") for name in function.function.name_out()]
    outputs = [given.get(name) or given[function.name] for name in names]
    return f"{export.name}_{function.name}({', '.join([*inputs, *outputs])});"
