"""Python script that reproduces the state of a window."""

from __future__ import annotations

import math
from typing import Any

import flexarm
from flexarm.model import PlantSpec
from flexarm.model.checks import Record
from flexarm.simulation.calls.result import package_version
from flexarm.view.studio.state import Project

_WIDTH = 96
_END = """\
tip, bent = result["tip"].values, abs(result["link_tip_deflection"]).max("time").values
print("tip at the end [m]:", *tip[-1])
print("largest deflection of each link [m]:", *bent)
# fa.report(result, "report.html")
# fa.animate(result, "arm.html")
"""


def script_of(project: Project) -> str:
    """Return the text of a program that simulates what a window shows, in ``result``."""
    names: dict[str, set[str]] = {}
    scenario = _code(project.scenario, names, 0, len("scenario = "))
    plant = project.plant
    lines = [f"scenario = {scenario}", ""]
    if plant is None or plant == PlantSpec():
        lines += ["result = fa.run_scenario(scenario)"]
    else:
        names.setdefault("flexarm.model.scenarios.study", set()).add("plant_spec")
        names.setdefault("flexarm.cases.scenario.scenario", set()).add("prepare")
        varied = _code(plant, names, 0, len("difference = "))
        lines += [
            "# The simulated arm differs from the design model of the controller.",
            f"difference = {varied}",
            "plant = fa.Arm(plant_spec(scenario.arm, difference))",
            "more = {'loads': difference.loads, 'changes': difference.changes}",
            "result = prepare(scenario).run(plant=plant, **more)",
        ]
    imports = ["import flexarm as fa"]
    for module in sorted(names):
        imports.append(f"from {module} import {', '.join(sorted(names[module]))}")
    head = f'"""A simulation, as shown by flexarm studio {package_version()}."""'
    return "\n".join([head, "", *imports, "", *lines, "", _END])


def _code(value: Any, names: dict[str, set[str]], indent: int, used: int) -> str:
    """Return an expression for a value; collect the classes in it by module.

    Args:
        indent: indentation of the line in which the expression begins.
        used: number of characters before the expression in that line.
    """
    if isinstance(value, Record):
        given = {name: part for name, part in value if name in value.model_fields_set}
        given.pop("kind", None)
        opening, closing = f"{_class_of(value, names)}(", ")"
        parts = [(f"{name}=", part) for name, part in given.items()]
    elif isinstance(value, dict):
        opening, closing = "{", "}"
        parts = [(f"{name!r}: ", part) for name, part in value.items()]
    elif isinstance(value, tuple):
        opening, closing = "[", "]"
        parts = [("", part) for part in value]
    else:
        infinite = isinstance(value, float) and math.isinf(value)
        return f'float("{value}")' if infinite else repr(value)
    inner = [name + _code(part, names, indent + 4, indent + 4 + len(name)) for name, part in parts]
    one_line = f"{opening}{', '.join(inner)}{closing}"
    if "\n" not in one_line and used + len(one_line) <= _WIDTH:
        return one_line
    space = " " * (indent + 4)
    return "\n".join([opening, *(f"{space}{part}," for part in inner), f"{' ' * indent}{closing}"])


def _class_of(record: Record, names: dict[str, set[str]]) -> str:
    """Return the name of a record's class, of `flexarm` if it is public there."""
    kind = type(record)
    if getattr(flexarm, kind.__name__, None) is kind:
        return f"fa.{kind.__name__}"
    names.setdefault(kind.__module__, set()).add(kind.__name__)
    return kind.__name__
