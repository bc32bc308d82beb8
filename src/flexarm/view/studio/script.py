"""Python scripts that simulate what a window shows."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from inspect import Parameter, signature
from typing import Any

import flexarm
from flexarm.base.references import package_version
from flexarm.cases.scenario.references import MOTION_FUNCTIONS
from flexarm.cases.scenario.scenario import (
    DriveContext,
    Prepared,
    Start,
    feedforward_kind,
    prepare,
)
from flexarm.control.laws import CONTROLLERS
from flexarm.model import PlantSpec, Scenario
from flexarm.model.arm.links import MATERIALS, Material
from flexarm.model.checks import Record
from flexarm.model.drives import FEEDFORWARD_DRIVES, ControllerDrive
from flexarm.model.scenarios.motions import PressedMotionSpec
from flexarm.view.studio.state import Project
from flexarm.view.studio.values.forms import kind_of

_WIDTH = 96
_END = """\
tip, bent = {0}["tip"].values, abs({0}["link_tip_deflection"]).max("time").values
print("tip at the end [m]:", *tip[-1])
print("largest deflection of each link [m]:", *bent)
"""
#: Calls that draw the results, by their number.
_DRAWN = {
    1: '# fa.report(result, "report.html")\n# fa.animate(result, "arm.html")\n',
    2: '# fa.animate({"result": result, "beside": beside}, "arms.html")\n',
}


def script_of(project: Project) -> str:
    """Return the text of a program that simulates what a window shows, in ``result``.

    The run of the drive beside is ``beside``; lines that both runs need stand there once.
    """
    writer, lines = _Writer(), list[str]()
    results = dict(zip(("result", "beside"), project.sides, strict=False))
    for name, side in results.items():
        written = writer.calls if _plain(side.scenario) else writer.records
        lines += [line for line in written(side, name) if line not in lines]
        lines += ["", _END.format(name)]
    imports = ["import flexarm as fa"]
    for module in sorted(writer.names):
        imports.append(f"from {module} import {', '.join(sorted(writer.names[module]))}")
    head = f'"""A simulation, as shown by flexarm studio {package_version()}."""'
    return "\n".join([head, "", *imports, "", *lines]) + _DRAWN[len(results)]


#: Parts of a scenario that are arguments of ``simulate``, and of a plant that are not of its arm.
_SAME = ("hardware", "loads", "base_acceleration", "contacts", "changes")
_ACTING = ("hardware", "loads", "changes")
#: Calls that create a flexible reference, by its kind; what controllers follow, and its torque.
_BENT = {
    "static": ("fa.quasi_static_reference(arm, motion, order=0)", "bent", "bent.torque"),
    "quasi_static": ("fa.quasi_static_reference(arm, motion)", "bent", "bent.torque"),
    "integral_manifold": ("fa.quasi_static_reference(arm, motion, order=2)", "bent", "bent.torque"),
    "tip_inversion": ("fa.tip_inversion(arm, motion)", "bent.reference", "bent.torque"),
    "flexible_torque": ("fa.flexible_torque(arm, motion)", "motion", "bent"),
}
_RIGID = ("", "motion", "fa.rigid_torque(arm, motion)")
_MOTORS = "rigid_inverse_dynamics"


def _plain(scenario: Scenario) -> bool:
    """Return whether a scenario is written with the functions of `flexarm`, or as one record."""
    drive, initial = scenario.drive, scenario.initial
    elsewhere = (
        scenario.prescribed or scenario.events or isinstance(scenario.motion, PressedMotionSpec),
        initial.balance or initial.base_position or initial.base_velocity,
        initial.equilibrium and (scenario.loads or scenario.contacts or scenario.base_acceleration),
        getattr(drive, "estimator", None) or drive.kind in ("torque", "tip_inversion"),
        isinstance(scenario.base_acceleration, Record),
    )
    return not any(elsewhere)


class _Code(str):
    """An expression that stands in a script as it is."""


class _Writer:
    """Writes lines, and collects the classes that are not in `flexarm`, by module."""

    def __init__(self) -> None:
        self.names: dict[str, set[str]] = {}

    def records(self, project: Project, result: str) -> Iterator[str]:
        """Yield the lines of a scenario as a record, like that of a file."""
        yield f"scenario = {self._code(project.scenario, 0, len('scenario = '))}\n"
        plant = project.plant or PlantSpec()
        if plant == PlantSpec():
            yield f"{result} = fa.run_scenario(scenario)"
            return
        self.names.setdefault("flexarm.model.scenarios.study", set()).add("plant_spec")
        self.names.setdefault("flexarm.cases.scenario.scenario", set()).add("prepare")
        yield f"difference = {self._code(plant, 0, len('difference = '))}"
        yield "plant = fa.Arm(plant_spec(scenario.arm, difference))"
        yield f"more = {self._code(_given(plant, _ACTING), 0, len('more = '))}"
        yield f"{result} = prepare(scenario).run(plant=plant, **more)"

    def calls(self, project: Project, result: str) -> Iterator[str]:
        """Yield the lines of a simulation with the functions of `flexarm`."""
        scenario, plant, of = project.scenario, project.plant, prepare(project.scenario)
        made, followed, torque = _BENT.get(of.followed.kind, _RIGID)
        options = _given(scenario, _SAME)
        yield self._call("arm", "fa.Arm", _given(scenario.arm))
        if plant is not None:
            acting, varied = _given(plant, _ACTING), _given(plant)
            varied = {name: value for name, value in varied.items() if name not in acting}
            if varied:
                yield self._call("plant", "fa.varied", varied, "arm")
                options["plant"] = _Code("plant")
            for name, more in acting.items():
                options[name] = more if name == "hardware" else (*options.get(name, ()), *more)
        yield from self._motion(scenario.motion)
        if made:
            yield f"bent = {made}"
        if isinstance(scenario.drive, ControllerDrive):
            if scenario.hardware is not None and _designed_for_hardware(scenario.drive):
                yield self._call("hardware", "fa.Hardware", _given(scenario.hardware))
                if options["hardware"] == scenario.hardware:
                    options["hardware"] = _Code("hardware")
            yield from self._controller("controller", scenario.drive, of, torque)
            options["controller"] = _Code("controller")
            if scenario.motion is not None:
                options["reference"] = _Code(followed)
        elif scenario.drive.kind in FEEDFORWARD_DRIVES:
            options["torque"] = _Code(torque)
        yield from self._start(scenario, of, options)
        settings = _given(scenario.run)
        duration = repr(settings.pop("duration"))
        yield self._call(result, "fa.simulate", options | settings, "arm", duration)

    def _motion(self, spec: Any) -> Iterator[str]:
        if spec is None:
            return
        given = _given(spec)
        shaping, smoothing = given.pop("shaping", None), given.pop("smoothing", None)
        yield self._call("motion", f"fa.{MOTION_FUNCTIONS[spec.kind].__name__}", given, "arm")
        if shaping is not None:
            yield self._call("motion", "fa.shaped", _given(shaping), "motion", "arm")
        if smoothing is not None:
            yield self._call("motion", "fa.smoothed", _given(smoothing), "motion")

    def _start(self, scenario: Scenario, of: Prepared, options: dict[str, Any]) -> Iterator[str]:
        """Yield the lines of an initial state that is computed; add it to the options."""
        initial = scenario.initial
        angles = "[0.0] * arm.n_joints" if scenario.motion is None else "motion.joint_angle(0.0)"
        if of.followed.initial is not None:
            options["initial"], angles = _Code("bent.initial"), "arm.joint_angles(bent.initial)"
        if initial.joint_angle is not None:
            angles = str(list(initial.joint_angle))
        if initial.joint_angle is not None or scenario.drive.kind == "none":
            options["initial"] = _Code(f"arm.rest({angles})")
        if initial.joint_rate is not None:
            options["initial_rate"] = _Code(f"arm.rest({list(initial.joint_rate)})")
        if initial.equilibrium:
            yield f"start = fa.equilibrium(arm, {angles})"
            options["initial"] = _Code("start.q")
        elif scenario.arm.closures:
            moving = tuple(k for k, rate in enumerate(initial.joint_rate or (), 1) if rate)
            rates = [options["initial_rate"]] if moving else []
            held = {"held": moving} if moving else {}
            yield self._call("start", "fa.assembled", held, "arm", f"arm.rest({angles})", *rates)
            options |= {"initial": _Code("start.q"), "initial_rate": _Code("start.qd")}

    def _controller(self, name: str, drive: Any, of: Prepared, torque: str) -> Iterator[str]:
        """Yield the lines of a controller, after those of the one that it contains."""
        law: Any = CONTROLLERS[drive.kind]
        given = _given(drive)
        given.pop("reference", None)
        if "inner" in given:
            yield from self._controller("inner", given["inner"], of, torque)
            given["inner"] = _Code("inner")
        if given.pop("hardware", False):
            given["hardware"] = _Code("hardware")
        gravity = given.pop("gravity", "none")
        if gravity != "none":
            given |= {"arm": _Code("arm")} | ({"sag": True} if gravity == "sag" else {})
        if "feedforward" in type(drive).model_fields:
            around = DriveContext(of.arm, None, of.followed, Start(of.options["initial"], {}), None)
            asked = feedforward_kind(drive, around)
            given.pop("feedforward", None)
            if asked != "reference":
                torque = _RIGID[2] if asked == _MOTORS else _BENT.get(asked, _RIGID)[0]
            if torque and (asked != "reference" or of.followed.torque is not None):
                given["feedforward"] = _Code(torque)
        needed = signature(law).parameters.get("arm")
        first = ["arm"] if needed is not None and needed.default is Parameter.empty else []
        yield self._call(name, f"fa.{law.__name__}", given, *first)

    def _call(self, name: str, call: str, named: Mapping[str, Any], *first: str) -> str:
        """Return the line that assigns the result of a call."""
        parts = [*(("", _Code(text)) for text in first), *((f"{k}=", v) for k, v in named.items())]
        return f"{name} = {self._joined(f'{call}(', parts, ')', 0, len(name) + 3)}"

    def _code(self, value: Any, indent: int, used: int) -> str:
        """Return an expression for a value that begins at ``used``."""
        if isinstance(value, _Code):
            return str(value)
        if isinstance(value, Material) and value in MATERIALS.values():
            return repr(next(name for name, known in MATERIALS.items() if known == value))
        if isinstance(value, Record):
            given = {name: part for name, part in value if name in value.model_fields_set}
            if kind_of(type(value)) is not None:
                given.pop("kind", None)
            parts = [(f"{name}=", part) for name, part in given.items()]
            return self._joined(f"{self._class_of(value)}(", parts, ")", indent, used)
        if isinstance(value, dict):
            parts = [(f"{name!r}: ", part) for name, part in value.items()]
            return self._joined("{", parts, "}", indent, used)
        if isinstance(value, tuple):
            return self._joined("[", [("", part) for part in value], "]", indent, used)
        infinite = isinstance(value, float) and math.isinf(value)
        return f'float("{value}")' if infinite else repr(value)

    def _joined(
        self, opening: str, parts: Sequence[tuple[str, Any]], closing: str, indent: int, used: int
    ) -> str:
        """Return an expression with parts, on one line if they fit."""
        inner = [
            name + self._code(part, indent + 4, indent + 4 + len(name)) for name, part in parts
        ]
        one_line = f"{opening}{', '.join(inner)}{closing}"
        if "\n" not in one_line and used + len(one_line) <= _WIDTH:
            return one_line
        space = " " * (indent + 4)
        lines = [opening, *(f"{space}{part}," for part in inner), f"{' ' * indent}{closing}"]
        return "\n".join(lines)

    def _class_of(self, record: Record) -> str:
        """Return the name of a record's class, of `flexarm` if it is public there."""
        kind = type(record)
        if getattr(flexarm, kind.__name__, None) is kind:
            return f"fa.{kind.__name__}"
        self.names.setdefault(kind.__module__, set()).add(kind.__name__)
        return kind.__name__


def _designed_for_hardware(drive: Any) -> bool:
    """Return whether the design of a controller, or of one inside it, includes the hardware."""
    inner = getattr(drive, "inner", None)
    return bool(getattr(drive, "hardware", None)) or (
        inner is not None and _designed_for_hardware(inner)
    )


def _given(record: Record, names: Collection[str] = ()) -> dict[str, Any]:
    """Return the values of a record that are not its defaults, without its kind; by default all."""
    fields = {k: field.default for k, field in type(record).model_fields.items() if k != "kind"}
    values = {k: getattr(record, k) for k in names or fields}
    return {k: value for k, value in values.items() if value != fields[k]}
