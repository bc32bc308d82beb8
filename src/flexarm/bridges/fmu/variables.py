"""Variables of an FMU: names, places, units and meaning."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.bridges.c_code.exported import Exported
from flexarm.linear.models.signals import find_inputs, find_outputs, state_names
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.tolerance import tip_units

#: Functions of the exported code that give outputs, and the channels of their results.
OUTPUTS = {
    "tip": ("tip", "tip_angle"),
    "tip_velocity": ("tip_velocity", "tip_angle_rate"),
    "strain": ("strain",),
    "energy": ("kinetic_energy", "strain_energy", "gravity_energy"),
}
#: Readings of the controller that the arm has as variables.
READINGS = ("joint_angle", "joint_rate", "strain", "tip")
_JOINT_INPUTS = {
    "reference_angle": ("rad", "joint angle to follow"),
    "reference_rate": ("rad/s", "rate of the joint angle to follow"),
    "reference_acceleration": ("rad/s^2", "acceleration of the joint angle to follow"),
    "feedforward": ("N m", "torque that is added, in the middle of the sample"),
    "reference_pressing": ("N m", "torque to press, in addition to that of the rigid model"),
    "rougher_angle": ("rad", "joint angle of the reference for more friction"),
    "rougher_rate": ("rad/s", "joint rate of the reference for more friction"),
    "rougher_acceleration": ("rad/s^2", "joint acceleration of the reference for more friction"),
    "rougher_pressing": ("N m", "torque to press of the reference for more friction"),
    "nominal_angle": ("rad", "joint angle of the nominal motion"),
    "nominal_torque": ("N m", "torque of the nominal motion"),
}
_OTHER_INPUTS = {
    "strain_correction": ("", "strain along the reference minus static strain"),
    "nominal_reading": ("", "reading of the nominal motion"),
    "nominal_tip": ("m", "x and y of the nominal tip, of straight links along a reference"),
    "nominal_force": ("", "elastic force of the nominal motion at a node of the preview"),
    "contact_force": ("N", "measured force of the contact on the arm, x and y, world axes"),
    "reference_force": ("N", "contact force on the surface; 0 for motion without contact"),
    "reference_normal": ("", "outward unit normal of the surface; zero without a surface"),
    "reference_force_rate": ("N/s", "rate of the contact force"),
    "reference_friction": ("", "coefficient of friction of the reference"),
    "rougher_friction": ("", "coefficient of friction of the reference for more friction"),
    "path_position": ("m", "x and y of the path of the tip on the surface"),
    "path_speed": ("m/s", "speed along the surface, in the direction (-normal y, normal x)"),
}


@dataclass(frozen=True)
class Variable:
    """Variable of an FMU; its value reference is its place in the list of all variables.

    Attributes:
        name, unit, description: as in ``flexarm.simulation.run.channels``; the unit may be empty.
        causality: "independent", "input", "parameter", "output" or "local".
        variability: "continuous", "discrete" or "fixed".
        start: initial value; None for computed variables.
        state: place of the state whose derivative this is.
        nominal: size of a state; None for other variables.
    """

    name: str
    unit: str
    description: str
    causality: str
    variability: str = "continuous"
    start: float | None = None
    state: int | None = None
    nominal: float | None = None


class Variables:
    """All variables of the FMU of an arm, and the places of the groups.

    Args:
        export: arm and controller.
        q, qd: (dof,) initial state.

    Attributes:
        all: the variables, by value reference.
        places: first value reference by argument of the C functions, such as "q" or "torque".
        units: (2 dof,) coordinates and rates that move the tip by one metre (per radian of phase).
    """

    def __init__(self, export: Exported, q: FloatArray, qd: FloatArray) -> None:
        self.all: list[Variable] = []
        self.places: dict[str, int] = {}
        self.units = tip_units(export.arm).reshape(2, -1)[:, export.arm.assembly.coordinates]
        self._put("time", [Variable("time", "s", "time", "independent")])
        self._put_states(export, q, qd)
        self._put_inputs(export, q)
        given = zip(export.parameters, export.nominal, strict=True)
        about = "number of the arm, in the unit of its file"
        self._put(
            "parameters",
            [
                Variable(path, "", about, "parameter", "fixed", float(value))
                for path, value in given
            ],
        )
        self._put_outputs(export)

    def _put(self, name: str, variables: Iterable[Variable]) -> None:
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
                    Variable(
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
            Variable(
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
        about = "force or moment on the last tip, world axes"
        force = [
            Variable(one.name, one.unit, about, "input", start=0.0)
            for one in find_inputs(arm, ["tip_force", "tip_moment"])
        ]
        self._put("tip_force", force)
        if not export.controller:
            meaning = CHANNELS["torque"].meaning
            rows = [
                Variable(one.name, one.unit, meaning, "input", start=0.0)
                for one in find_inputs(arm, ["torque"])
            ]
            self._put("torque", rows)
            return
        sizes = {
            name: function.function.numel_in(name)
            for function in export.controller.functions
            for name in function.inputs
            if name not in (*READINGS, "memory")
        }
        for name, size in sizes.items():
            start = export.controller.defaults.get(name)
            if start is None and name == "reference_angle":
                start = q[arm.joint_index]
            values = [0.0] * size if start is None else [float(one) for one in start]
            planned = ("", "planned input of the controller")
            unit, meaning = (_JOINT_INPUTS | _OTHER_INPUTS).get(name, planned)
            numbers = arm.joint_numbers if name in _JOINT_INPUTS else range(1, size + 1)
            rows = [
                Variable(f"{name}[{number}]", unit, meaning, "input", start=value)
                for number, value in zip(numbers, values, strict=True)
            ]
            self._put(name, rows)

    def _put_outputs(self, export: Exported) -> None:
        self.places["outputs"] = len(self.all)
        for function in export.functions:
            rows = []
            for channel in OUTPUTS.get(function.name, ()):
                meaning, unit = CHANNELS[channel].meaning, CHANNELS[channel].unit
                labels = [channel]
                if CHANNELS[channel].dims:
                    labels = list(find_outputs(export.arm, [channel])[0].names)
                rows += [Variable(label, unit, meaning, "output") for label in labels]
            if rows:
                self._put(function.name, rows)
        if export.controller:
            meaning = "torque of the controller, constant from sample to sample"
            rows = [
                Variable(one.name, one.unit, meaning, "output", "discrete")
                for one in find_inputs(export.arm, ["torque"])
            ]
            self._put("torque", rows)
