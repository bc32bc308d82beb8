"""Header of the exported C code."""

from __future__ import annotations

from flexarm.bridges.c_code.exported import Exported, origin, prototype
from flexarm.bridges.c_code.named_function import NamedFunction
from flexarm.bridges.c_code.observer import Observer
from flexarm.linear.models.state_space import state_names

#: Meaning of arguments.
_MEANINGS = {
    "q": "coordinates",
    "qd": "rates of the coordinates",
    "qdd": "accelerations of the coordinates",
    "torque": "torque of each joint, N m",
    "tip_force": "Fx, Fy (N) and Mz (N m) on the last tip; NULL for none",
    "step": "length of the step, s",
    "parameters": "in the units of the file; NULL for {name}_nominal",
    "force": "generalised force; N m in the entries of joints",
    "bias": "generalised force; N m in the entries of joints",
    "mass": "mass matrix",
    "energy": "kinetic, strain, gravity, J",
    "tip_velocity": "rates of x, y (m/s) and of the angle (rad/s)",
    "jacobian": "derivative of x, y (m) and angle (rad) by the coordinates",
    "q_next": "coordinates after the step",
    "qd_next": "rates after the step",
    "by_state": "derivative of (q_next, qd_next) by (q, qd)",
    "by_torque": "derivative of (q_next, qd_next) by the torque",
    "memory": "memory of the controller between samples",
    "joint_angle": "measured joint angles, relative, rad",
    "joint_rate": "measured joint rates, relative, rad/s",
    "strain": "strain at each gauge",
    "contact_force": "measured force of the first contact on the arm, N, world axes",
    "tip": "x, y (m) and, of the arm, the angle (rad) of the last tip",
    "reference_angle": "joint angles to follow, rad",
    "reference_rate": "joint rates to follow, rad/s",
    "reference_acceleration": "joint accelerations to follow, rad/s^2",
    "reference_pressing": "torque to press, in addition to that of the rigid model, N m",
    "reference_force": "contact force of the tip on the surface, N; 0 for motion without contact",
    "reference_normal": "outward unit normal of the surface, world axes; 0, 0 without a surface",
    "reference_force_rate": "rate of the contact force, N/s",
    "reference_friction": "coefficient of friction of the reference; NULL for 0",
    "rougher_angle": "joint angles of the reference for more friction, rad",
    "rougher_rate": "joint rates of the reference for more friction, rad/s",
    "rougher_acceleration": "joint accelerations of the reference for more friction, rad/s^2",
    "rougher_pressing": "torque to press of the reference for more friction, N m",
    "rougher_friction": "its coefficient of friction, another than of the reference; NULL for 1",
    "path_position": "x, y (m) of the path of the tip on the surface",
    "path_speed": "speed along the surface, in the direction (-normal y, normal x), m/s",
    "strain_correction": "strain along the reference minus static strain; NULL for 0",
    "feedforward": "torque in the middle of the sample that is added, N m; NULL for none",
    "readings": "of the instruments, in the order above",
    "last_torque": "torque of each joint since the last sample, N m",
    "observer_memory": "[q, qd, logarithm of the moved mass], then their covariance by rows",
    "estimated_q": "coordinates",
    "estimated_qd": "rates of the coordinates",
    "estimated_payload": "mass of the payload, kg",
    "innovation": "normalised innovation squared per reading, one on average",
    "nominal_angle": "joint angles of the nominal motion, rad; NULL for rest",
    "nominal_torque": "torque of the nominal motion, N m; NULL for rest",
    "nominal_reading": "readings of the nominal motion; NULL for rest",
    "nominal_tip": "x, y (m) of the nominal tip, of straight links on a reference; NULL for rest",
    "nominal_force": "its elastic forces without actuator at the preview's nodes; NULL for rest",
}
_RULES = """\
 *
 * C99. No allocation, no data that change between calls, no loop whose length depends on a value:
 * all functions may be called from several threads and from interrupts. Results must not overlap
 * arguments. Matrices are stored by rows. SI units; forces and positions in world axes.
"""


def header(export: Exported) -> str:
    """Return the text of the header."""
    guard = export.macro("H")
    title = "planar arm with flexible links"
    lines = [origin(f"{export.name}.h", title) + _RULES + _coordinates(export) + " */"]
    lines += [f"#ifndef {guard}", f"#define {guard}", "", "#ifdef __cplusplus"]
    lines += ['extern "C" {', "#endif", ""]
    lines += [f"#define {export.macro(key)} {value}" for key, value in export.sizes.items()]
    lines += ["", "/* Longest stable step about straight links, s. */"]
    lines += [f"#define {export.macro('LARGEST_STEP')} {export.largest_step!r}", ""]
    if export.parameters:
        lines += _parameters(export)
    for function in export.functions:
        lines += [_comment(export, function), _declared(export, function), ""]
    if export.controller:
        lines += ["/* Time from one call of the controller to the next, s. */"]
        lines += [f"#define {export.macro('SAMPLE_TIME')} {export.controller.sample_time!r}", ""]
        for function in export.controller.functions:
            lines += [_comment(export, function), _declared(export, function), ""]
    if export.observer:
        lines += [_of_observer(export, export.observer)]
        lines += [f"#define {export.macro('OBSERVER_TIME')} {export.observer.sample_time!r}", ""]
        for function in export.observer.functions:
            lines += [_comment(export, function), _declared(export, function), ""]
    lines += ["#ifdef __cplusplus", "}", "#endif", "", "#endif", ""]
    return "\n".join(lines)


def _coordinates(export: Exported) -> str:
    names, units = state_names(export.arm)
    rows = zip(names[: export.arm.dof], units, strict=False)
    listed = [f" *   q[{k}]  {name}, {unit}" for k, (name, unit) in enumerate(rows)]
    return "\n".join([" *", " * Coordinates, numbered from 1 by link and mode:", *listed, ""])


def _of_observer(export: Exported, observer: Observer) -> str:
    """Return the comment with the readings of the observer."""
    rows = [f" *   readings[{k}]  {text}" for k, text in enumerate(observer.reading_names)]
    listed = "\n".join(["/* Readings of the observer:", " *", *rows, " */"])
    return f"{listed}\n\n/* Time from one call of the observer to the next, s. */"


def _parameters(export: Exported) -> list[str]:
    places = [f"    {place}" for place in parameter_places(export)]
    paths = [f"/* {path} */" for path in export.parameters]
    last = len(places) - 1
    rows = [
        f"{place}{',' if k < last else ''} {path}"
        for k, (place, path) in enumerate(zip(places, paths, strict=True))
    ]
    size = export.macro("PARAMETERS")
    lines = ["/* Places of the parameters in their array. */", "enum {", *rows, "};", ""]
    lines += ["/* Values of the parameters in the arm. */"]
    return [*lines, f"extern const double {export.name}_nominal[{size}];", ""]


def parameter_places(export: Exported) -> list[str]:
    """Return the names of the places of parameters, such as ``ARM_PAYLOAD_MASS``."""
    plain = str.maketrans({"[": "_", ".": "_", "]": ""})
    return [export.macro(path.translate(plain)) for path in export.parameters]


def _comment(export: Exported, function: NamedFunction) -> str:
    count = f" {function.operations} operations." if function.operations else ""
    outputs = [name.removesuffix("_out") for name in function.function.name_out()]
    names = [*function.given, *outputs]
    width = max(map(len, names))
    meanings = {name: _MEANINGS.get(name, "planned input of the controller") for name in names}
    rows = [f" *   {name:<{width}}  {meanings[name].format(name=export.name)}" for name in names]
    return "\n".join([f"/* {function.summary}{count}", " *", *rows, " */"])


def _declared(export: Exported, function: NamedFunction) -> str:
    return prototype(f"{export.name}_{function.name}", export.arguments(function)) + ";"
