"""Inputs and outputs of linear models: names, units, and points of application."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import InputError, Problem, shown
from flexarm.model import Load, Sensor

_AXES = ("x", "y")


class Input(NamedTuple):
    """One scalar input; exactly one of ``joint``, ``load`` and ``axis`` is set."""

    name: str
    unit: str
    joint: int | None = None  # position among the joints
    gain: float = 1.0  # torque (N m) of a joint by the input
    load: Load | None = None  # the load of a unit input
    axis: int | None = None  # axis of the acceleration of the base


class Output(NamedTuple):
    """Outputs that are evaluated together: a channel of results, the torque, or a sensor."""

    names: tuple[str, ...]
    unit: str
    channel: str | None = None
    sensor: Sensor | None = None


#: Channels of results that can be outputs: the objects that count their columns, and the unit.
CHANNEL_OUTPUTS = {
    "joint_angle": ("joint", "rad"),
    "joint_rate": ("joint", "rad/s"),
    "joint_twist": ("joint", "rad"),
    "link_angle": ("link", "rad"),
    "link_rate": ("link", "rad/s"),
    "link_tip_deflection": ("link", "m"),
    "link_tip_slope": ("link", "rad"),
    "link_tip_deflection_rate": ("link", "m/s"),
    "link_tip_slope_rate": ("link", "rad/s"),
    "tip": ("axis", "m"),
    "tip_velocity": ("axis", "m/s"),
    "tip_angle": ("", "rad"),
    "tip_angle_rate": ("", "rad/s"),
    "strain": ("gauge", "1"),
    "torque": ("joint", "N m"),
    "contact_force": ("contact", "N"),
    "contact_gap": ("contact", "m"),
}
INPUTS = ("torque", "voltage", "tip_force", "tip_moment", "base_acceleration")

InputName = str | Load | tuple[str, Load]
OutputName = str | Sensor


def find_inputs(arm: Arm, requested: Sequence[InputName]) -> list[Input]:
    """Return the inputs for the names and loads that the user gives, each with a different name."""
    found: list[Input] = []
    loads = 0
    for item in _listed(requested):
        if isinstance(item, str):
            found += _named_inputs(arm, item)
            continue
        loads += 1
        name, load = (
            item if isinstance(item, tuple) and len(item) == 2 else (f"load[{loads}]", item)
        )
        if not isinstance(load, Load):
            rule = "be names, Load objects, or pairs of a name and a Load"
            raise InputError(Problem("inputs", rule, shown(item)))
        unit = "N/m" if load.spread is not None else "N" if np.any(load.force) else "N m"
        if load.factor is None and np.any(load.value):
            # The numbers of the load give its direction; the input scales them.
            found.append(Input(str(name), f"x {unit}", load=load))
        else:
            rule = "have a nonzero force or moment, and no factor"
            raise InputError(Problem(f"inputs {name!r}", rule, shown(load.value)))
    _check_names("inputs", [item.name for item in found])
    return found


def _named_inputs(arm: Arm, name: str) -> list[Input]:
    last = arm.links
    if name == "torque":
        return [Input(f"torque[{n}]", "N m", joint=k) for k, n in enumerate(arm.joint_numbers)]
    if name == "voltage":
        return _voltages(arm)
    if name == "tip_force":
        forces = ((1.0, 0.0), (0.0, 1.0))
        return [
            Input(f"tip_force[{axis}]", "N", load=Load(link=last, force=force))
            for axis, force in zip(_AXES, forces, strict=True)
        ]
    if name == "tip_moment":
        return [Input("tip_moment", "N m", load=Load(link=last, moment=1.0))]
    if name == "base_acceleration":
        return [Input(f"base_acceleration[{a}]", "m/s^2", axis=k) for k, a in enumerate(_AXES)]
    rule = "be a Load or one of " + ", ".join(map(repr, INPUTS))
    raise InputError(Problem("inputs", rule, shown(name)))


def _voltages(arm: Arm) -> list[Input]:
    """Return the voltages of joints with a winding; their damping contains the back-EMF."""
    voltages = []
    for k, n in enumerate(arm.joint_numbers):
        joint = arm.spec.joints[n - 1]
        if joint.winding is not None:
            voltages.append(Input(f"voltage[{n}]", "V", joint=k, gain=joint.torque_per_voltage))
    if not voltages:
        hint = "Give its joints a winding: fa.Joint(..., winding=fa.Winding(...))."
        raise InputError(
            Problem("inputs", "contain voltage, but no joint has a winding", hint=hint)
        )
    return voltages


def find_outputs(arm: Arm, requested: Sequence[OutputName], contacts: int = 0) -> list[Output]:
    """Return the outputs for names and sensors, with the contacts at the operating point."""
    counted = {
        "joint": [str(n) for n in arm.joint_numbers],
        "link": [str(n) for n in range(1, arm.links + 1)],
        "gauge": [str(n) for n in range(1, len(arm.gauges) + 1)],
        "axis": list(_AXES),
        "contact": [str(n) for n in range(1, contacts + 1)],
    }
    found = []
    for item in _listed(requested):
        if isinstance(item, Sensor):
            place_loads(arm, [marker(item.link, item.station)], what="Sensor")
            found.append(Output(tuple(item.labels()), item.unit, sensor=item))
            continue
        if not isinstance(item, str) or item not in CHANNEL_OUTPUTS:
            rule = "be a Sensor or one of " + ", ".join(map(repr, CHANNEL_OUTPUTS))
            raise InputError(Problem("outputs", rule, shown(item)))
        if item == "strain" and not arm.gauges:
            raise InputError(Problem("outputs", "contain strain, but the arm has no gauges"))
        by, unit = CHANNEL_OUTPUTS[item]
        if by == "contact" and not contacts:
            raise InputError(Problem("outputs", f"contain {item}, but there are no contacts"))
        if item == "contact_force":
            forces = (f"{item}[{n},{axis}]" for n in range(1, contacts + 1) for axis in _AXES)
            found.append(Output(tuple(forces), unit, channel=item))
            continue
        names = tuple(f"{item}[{n}]" for n in counted[by]) if by else (item,)
        found.append(Output(names, unit, channel=item))
    _check_names("outputs", [name for item in found for name in item.names])
    return found


def _listed(requested: object) -> list[object]:
    """Return a list of names; a single name becomes a list of one."""
    pair = isinstance(requested, tuple) and len(requested) == 2 and isinstance(requested[1], Load)
    if isinstance(requested, (str, Load, Sensor)) or pair:
        return [requested]
    if not isinstance(requested, list | tuple):
        rule = "be names, Loads or Sensors"
        raise InputError(Problem("inputs and outputs", rule, shown(requested)))
    return list(requested)


def _check_names(which: str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        rule = "have different names"
        hint = "Give a Sensor or a Load its own name."
        raise InputError(Problem(which, rule, ", ".join(twice), hint))
    dotted = next((name for name in names if "." in name), None)
    if dotted is not None:
        rule = "have names without dots (python-control splits names at dots)"
        raise InputError(Problem(which, rule, shown(dotted)))


def state_names(arm: Arm) -> tuple[list[str], list[str]]:
    """Return names and units of the states: the coordinates, then their rates, 2 dof of each."""
    names = [""] * arm.dof
    rates = [""] * arm.dof
    units = ["m kg^0.5"] * arm.dof
    for seat in arm.assembly.seats:
        n = seat.link + 1
        names[seat.angle], rates[seat.angle] = f"joint_angle[{n}]", f"joint_rate[{n}]"
        units[seat.angle] = "rad"
        if seat.twist is not None:
            names[seat.twist], rates[seat.twist] = f"joint_twist[{n}]", f"joint_twist_rate[{n}]"
            units[seat.twist] = "rad"
    counts = [0] * arm.links
    for piece in arm.assembly.pieces:
        for place in range(piece.modal.start, piece.modal.stop):
            counts[piece.link] += 1
            number = f"[{piece.link + 1},{counts[piece.link]}]"
            names[place], rates[place] = f"mode{number}", f"mode_rate{number}"
    return names + rates, units + [f"{unit}/s" for unit in units]


def torque_places(inputs: list[Input], joints: int) -> FloatArray:
    """Return the derivative (joints, inputs) of the torque by the inputs, N m per unit of each."""
    matrix = np.zeros((joints, len(inputs)))
    for column, item in enumerate(inputs):
        if item.joint is not None:
            matrix[item.joint, column] = item.gain
    return matrix
