"""Export of functional mock-up units (FMI 2.0 and 3.0)."""

from __future__ import annotations

import hashlib
import io
import platform
import shutil
import subprocess
import sys
import uuid
import zipfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from importlib.resources import files
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from xml.etree import ElementTree as XML

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice
from flexarm.base.errors import FlexarmWarning, InputError, Problem, public_call, shown, warn_caller
from flexarm.base.writing.places import check_place, write_whole
from flexarm.bridges.c_code.export import check_prefix, exported
from flexarm.bridges.c_code.model_functions import NamedFunction
from flexarm.bridges.c_code.source import EXTENTS, MEANINGS, PLANNED, Exported, array, origin
from flexarm.bridges.symbolic.models import exported_model
from flexarm.control.contract.base import Controller, check_controller
from flexarm.integrate.explicit_runge_kutta.dormand_prince import DormandPrince8
from flexarm.linear.models.state_space import find_inputs, find_outputs, state_names
from flexarm.simulation.calls.preparation import initial_state
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.tolerance import RTOL, absolute_tolerance, tip_units

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
    state = initial_state(arm, initial, initial_rate, np.zeros(arm.n_joints))
    q, qd = state.reshape(2, -1)[:, arm.assembly.coordinates]
    whole = exported(model, prefix, controller)
    export = replace(whole, functions=[f for f in whole.functions if f.name in _FUNCTIONS])
    place = check_place("path", path, (".fmu",))

    variables = _Variables(export, q, qd)
    write_whole(place, [_archive(export, variables, version)])
    return place


def _archive(export: Exported, variables: _Variables, fmi: str) -> bytes:
    from flexarm.bridges.c_code.source import header, source

    name, glue = export.name, f"fmi{fmi[0]}"
    own = files("flexarm.bridges.fmu") / "c"
    texts = {
        file: (own / file).read_text(encoding="utf-8")
        for file in ("fmu_core.h", f"{glue}_interface.h", f"{glue}.c")
    }
    texts |= {f"{name}.h": header(export), f"{name}.c": source(export)}
    # Equations and start values identify the FMU.
    whole = "".join([*texts.values(), _model_header(export, variables, ""), repr(variables.all)])
    token = "{" + str(uuid.UUID(hashlib.sha256(whole.encode()).hexdigest()[:32])) + "}"
    texts["fmu_model.h"] = _model_header(export, variables, token)
    sources = [f"{name}.c", f"{glue}.c"]
    step = export.controller.sample_time if export.controller else _STEP
    described = _model_description(fmi, name, token, sources, variables.all, step)
    content = {"modelDescription.xml": described}
    content |= {f"sources/{file}": text.encode() for file, text in texts.items()}
    if fmi == "3.0":
        root = XML.Element("fmiBuildDescription", fmiVersion="3.0")
        build = XML.SubElement(root, "BuildConfiguration", modelIdentifier=name)
        listed = XML.SubElement(build, "SourceFileSet", language="C99")
        for file in sources:
            XML.SubElement(listed, "SourceFile", name=file)
        XML.SubElement(build, "Library", name="m", external="true")
        content["sources/buildDescription.xml"] = _bytes(root)
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


#: Compilers, in the order of preference.
_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")
#: Folder of the library in the archive, by processor and version of FMI.
_FOLDERS = {
    ("x86_64", "2.0"): "linux64",
    ("x86_64", "3.0"): "x86_64-linux",
    ("aarch64", "3.0"): "aarch64-linux",
}


def compiled(fmi: str, name: str, files: dict[str, str], sources: list[str]) -> tuple[str, bytes]:
    """Return the place of the library in the archive and its content; OSError if it fails."""
    folder = _FOLDERS.get((platform.machine(), fmi)) if sys.platform == "linux" else None
    if folder is None:
        raise OSError(f"binaries for FMI {fmi} are made on Linux only (x86-64; FMI 3.0 also arm64)")
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise OSError(f"no C compiler was found ({', '.join(_COMPILERS)})")
    with TemporaryDirectory() as temporary:
        place = Path(temporary)
        for file, text in files.items():
            (place / file).write_text(text, encoding="utf-8")
        library = place / f"{name}.so"
        command = [compiler, *_FLAGS, "-o", str(library), *sources, "-lm"]
        done = subprocess.run(
            command, cwd=place, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0:
            first = next(iter(done.stderr.splitlines()), "")
            raise OSError(f"the C compiler failed: {first}")
        return f"binaries/{folder}/{name}.so", library.read_bytes()


#: Exponents of SI base units; modal coordinates have a fractional one, which FMI cannot express.
_UNITS: dict[str, dict[str, int]] = {
    "1": {},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s^2": {"rad": 1, "s": -2},
    "m": {"m": 1},
    "m/s": {"m": 1, "s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N m": {"kg": 1, "m": 2, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "N/s": {"kg": 1, "m": 1, "s": -3},
}


def _model_description(
    fmi: str, name: str, token: str, sources: list[str], variables: list[_Variable], step: float
) -> bytes:
    """Return ``modelDescription.xml``; ``step`` (s) is the proposed communication step."""
    two = fmi == "2.0"
    root = XML.Element("fmiModelDescription", fmiVersion=fmi, modelName=name)
    root.set("guid" if two else "instantiationToken", token)
    root.set("description", "planar arm with flexible links")
    root.set("generationTool", f"flexarm {version('flexarm')}")
    root.set("variableNamingConvention", "flat")
    if two:
        root.set("numberOfEventIndicators", "0")
    saves = ("canGetAndSetFMUstate", "canSerializeFMUstate")
    for kind in ("ModelExchange", "CoSimulation"):
        element = XML.SubElement(root, kind, modelIdentifier=name)
        for save in saves:
            element.set(save if two else save.replace("FMUstate", "FMUState"), "true")
        if kind == "CoSimulation":
            element.set("canHandleVariableCommunicationStepSize", "true")
        elif two:
            element.set("completedIntegratorStepNotNeeded", "true")
        if two:
            element.set("canNotUseMemoryManagementFunctions", "true")
            files = XML.SubElement(element, "SourceFiles")
            for source in sources:
                XML.SubElement(files, "File", name=source)
    units = XML.SubElement(root, "UnitDefinitions")
    for unit in dict.fromkeys(variable.unit for variable in variables if variable.unit):
        element = XML.SubElement(units, "Unit", name=unit)
        if unit in _UNITS:
            exponents = {key: str(power) for key, power in _UNITS[unit].items()}
            XML.SubElement(element, "BaseUnit", exponents)
    if two:
        categories = XML.SubElement(root, "LogCategories")
        XML.SubElement(categories, "Category", name="logStatusError")
    XML.SubElement(root, "DefaultExperiment", startTime="0", tolerance="1e-07", stepSize=repr(step))
    listed = XML.SubElement(root, "ModelVariables")
    for place, variable in enumerate(variables):
        attributes = {"name": variable.name, "valueReference": str(place)}
        attributes |= {"description": variable.description, "causality": variable.causality}
        attributes["variability"] = variable.variability
        if _initial(variable):
            attributes["initial"] = _initial(variable)
        about, numbers = attributes, _numbers(variable, 1 if two else 0)
        if two:
            XML.SubElement(XML.SubElement(listed, "ScalarVariable", about), "Real", numbers)
        else:
            XML.SubElement(listed, "Float64", about | numbers)
    _add_structure(root, two, variables)
    return _bytes(root)


def _bytes(root: XML.Element) -> bytes:
    XML.indent(root)
    return bytes(XML.tostring(root, encoding="utf-8", xml_declaration=True)) + b"\n"


def _initial(variable: _Variable) -> str:
    """Return the attribute ``initial``; inputs and time have none."""
    if variable.causality in ("input", "independent"):
        return ""
    return "calculated" if variable.start is None else "exact"


def _numbers(variable: _Variable, first: int) -> dict[str, str]:
    """Return the attributes of a number; states are counted from ``first``."""
    attributes = {"unit": variable.unit} if variable.unit else {}
    if variable.start is not None:
        attributes["start"] = repr(variable.start)
    if variable.nominal is not None:
        attributes["nominal"] = repr(variable.nominal)
    if variable.state is not None:
        attributes["derivative"] = str(variable.state + first)
    return attributes


def _add_structure(root: XML.Element, two: bool, variables: list[_Variable]) -> None:
    structure = XML.SubElement(root, "ModelStructure")
    numbered = list(enumerate(variables))
    outputs = [k for k, one in numbered if one.causality == "output"]
    derivatives = [k for k, one in numbered if one.state is not None]
    unknown = [
        k
        for k, one in numbered
        if _initial(one) == "calculated" and (one.causality == "output" or one.state is not None)
    ]
    groups = {"Outputs": outputs, "Derivatives": derivatives, "InitialUnknowns": unknown}
    names = {"Outputs": "Output", "Derivatives": "ContinuousStateDerivative"}
    for group, places in groups.items():
        if two:
            parent = XML.SubElement(structure, group) if places else structure
            for place in places:
                XML.SubElement(parent, "Unknown", index=str(place + 1))
        else:
            for place in places:
                name = names.get(group, "InitialUnknown")
                XML.SubElement(structure, name, valueReference=str(place))


#: First step of co-simulation, as a part of the longest stable one.
_FIRST = 0.2


def _model_header(export: Exported, variables: _Variables, token: str) -> str:
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

    def call(function: NamedFunction, places: dict[str, str]) -> str:
        return export.call(function, lambda name: places.get(name) or places[function.name])

    text = [
        f"static void fmu_accelerations({head})",
        "{",
        f"    {call(functions['forward_dynamics'], moved)}",
        "}",
        "",
        "static void fmu_outputs(double *v)",
        "{",
        *(f"    {call(functions[name], given)}" for name in _OUTPUTS if name in functions),
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
    copies += ["    (void)memory;", "    (void)first;"]
    lines = export.sampled_call(export.controller.functions, "first", given.__getitem__)
    head = "static void fmu_sample(double *v, double *memory, int first)"
    return [head, "{", *copies, *(f"    {line}" for line in lines), "}", ""]


#: Functions of the exported code that give outputs, and the channels of their results.
_OUTPUTS = {
    "tip": ("tip", "tip_angle"),
    "tip_velocity": ("tip_velocity", "tip_angle_rate"),
    "strain": ("strain",),
    "energy": ("kinetic_energy", "strain_energy", "gravity_energy"),
}
#: Readings of the controller that the arm has as variables.
_READINGS = ("joint_angle", "joint_rate", "strain", "tip")


def _described(argument: str) -> tuple[str, str]:
    """Return the meaning and the unit of an argument of the controller."""
    text = MEANINGS.get(argument, PLANNED).partition("; NULL")[0]
    meaning, _, unit = text.rpartition(", ")
    return (meaning, unit) if unit in _UNITS else (text, "")


@dataclass(frozen=True)
class _Variable:
    """Variable of an FMU; its value reference is its place in the list of all variables."""

    name: str  # as in ``flexarm.simulation.run.channels``
    unit: str  # likewise; may be empty
    description: str  # likewise
    causality: str  # "independent", "input", "parameter", "output" or "local"
    variability: str = "continuous"  # "continuous", "discrete" or "fixed"
    start: float | None = None  # initial value; None for computed variables
    state: int | None = None  # place of the state whose derivative this is
    nominal: float | None = None  # size of a state; None for other variables


class _Variables:
    """All variables of the FMU of an arm by value reference, and the places of the groups."""

    def __init__(self, export: Exported, q: FloatArray, qd: FloatArray) -> None:
        self.all: list[_Variable] = []
        #: First value reference by argument of the C functions, such as "q" or "torque".
        self.places: dict[str, int] = {}
        #: (2 dof,) coordinates and rates that move the tip by one metre (per radian of phase).
        self.units = tip_units(export.arm).reshape(2, -1)[:, export.arm.assembly.coordinates]
        self._put("time", [_Variable("time", "s", "time", "independent")])
        self._put_states(export, q, qd)
        self._put_inputs(export, q)
        given = zip(export.parameters, export.nominal, strict=True)
        about = "number of the arm, in the unit of its file"
        self._put(
            "parameters",
            [
                _Variable(path, "", about, "parameter", "fixed", float(value))
                for path, value in given
            ],
        )
        self.places["outputs"] = len(self.all)
        for function in export.functions:
            rows = []
            for channel in _OUTPUTS.get(function.name, ()):
                meaning, unit = CHANNELS[channel].meaning, CHANNELS[channel].unit
                labels = [channel]
                if CHANNELS[channel].dims:
                    labels = list(find_outputs(export.arm, [channel])[0].names)
                rows += [_Variable(label, unit, meaning, "output") for label in labels]
            if rows:
                self._put(function.name, rows)
        if export.controller:
            meaning = "torque of the controller, constant from sample to sample"
            torque = find_inputs(export.arm, ["torque"])
            rows = [_Variable(*one[:2], meaning, "output", "discrete") for one in torque]
            self._put("torque", rows)

    def _put(self, name: str, variables: Iterable[_Variable]) -> None:
        self.places[name] = len(self.all)
        self.all += variables

    def _put_states(self, export: Exported, q: FloatArray, qd: FloatArray) -> None:
        """Add q, their rates, and their accelerations; rates are the derivatives of q."""
        names, units = state_names(export.arm)
        n = export.arm.dof
        for level, (key, start) in enumerate({"q": q, "qd": qd}.items()):
            rows = []
            for k in range(n):
                name, unit = names[level * n + k], units[level * n + k]
                channel = CHANNELS.get(name.partition("[")[0])
                rows.append(
                    _Variable(
                        name,
                        unit,
                        channel.meaning if channel else ("modal coordinate", "its rate")[level],
                        "output" if channel else "local",
                        start=float(start[k]),
                        state=self.places["q"] + k if level else None,
                        nominal=float(self.units[level, k]),
                    )
                )
            self._put(key, rows)
        accelerations = [
            _Variable(
                name.replace("_rate", "_acceleration"),
                f"{unit}^2",
                "acceleration of the coordinate",
                "local",
                state=self.places["qd"] + k,
            )
            for k, (name, unit) in enumerate(zip(names[n:], units[n:], strict=True))
        ]
        self._put("qdd", accelerations)

    def _put_inputs(self, export: Exported, q: FloatArray) -> None:
        arm = export.arm
        force = find_inputs(arm, ["tip_force", "tip_moment"])
        about = "force or moment on the last tip, world axes"
        self._put("tip_force", [_Variable(*one[:2], about, "input", start=0.0) for one in force])
        if not export.controller:
            torque, about = find_inputs(arm, ["torque"]), CHANNELS["torque"].meaning
            self._put("torque", [_Variable(*one[:2], about, "input", start=0.0) for one in torque])
            return
        sizes = {
            name: function.function.numel_in(name)
            for function in export.controller.functions
            for name in function.inputs
            if name not in (*_READINGS, "memory")
        }
        for name, size in sizes.items():
            start = export.controller.defaults.get(name)
            if start is None and name == "reference_angle":
                start = q[arm.joint_index]
            values = [0.0] * size if start is None else [float(one) for one in start]
            meaning, unit = _described(name)
            by_joint = EXTENTS.get(name) == "{JOINTS}"
            numbers = arm.joint_numbers if by_joint else range(1, size + 1)
            rows = [
                _Variable(f"{name}[{number}]", unit, meaning, "input", start=value)
                for number, value in zip(numbers, values, strict=True)
            ]
            self._put(name, rows)
