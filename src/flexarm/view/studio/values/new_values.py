"""Starting values of what is added to a scenario: loads, contacts, instruments, tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.model import Instrument, InstrumentFault, Scenario
from flexarm.model.arm.joints import Friction, JointLimits, Winding
from flexarm.model.arm.links import Gauge, ModalDamping, RayleighDamping
from flexarm.model.arm.sections import Box, Circle, Rectangle, Tube
from flexarm.model.checks import Record
from flexarm.model.environment.changes import PAYLOAD_MASS, Change, ValueTable
from flexarm.model.environment.contacts import Contact, RoundWall, SurfaceTable, Wall
from flexarm.model.environment.loads import Load
from flexarm.model.environment.tables import AccelerationTable, FactorTable
from flexarm.model.scenarios.events import JointEvent, TipEvent
from flexarm.model.scenarios.motions import ForceTable, SmoothingSpec
from flexarm.model.scenarios.scenario import FollowingJoint, HeldJoint, TabulatedJoint
from flexarm.model.wording import Path
from flexarm.view.studio.values.drive_starts import drive_of_kind
from flexarm.view.studio.values.forms import Form, Forms, forms_of, kind_of
from flexarm.view.studio.values.starts import ends_of, motion_of_kind, short

#: Largest static deflection of the arm by the force of a new load, relative to its length, and
#: stiffness of a new surface relative to that of the arm.
_DEFLECTION, _HARDER = 0.02, 1000.0
#: Free space between the tip and a new surface, relative to the length of the arm.
_SPACE = 0.05


def new_value(
    scenario: Scenario, path: Path, forms: Forms, kind: str | None = None, old: Any = None
) -> Any:
    """Return a starting value for a place in a scenario, as a file has it.

    Args:
        path: of the value in the scenario.
        forms: of the value. kind: of its record, if there are several.
        old: the value to replace, or None.

    A kind that does not exist is returned alone, so that the records report what is wrong.
    """
    if kind is None:
        return _plain(scenario, forms.given[0], 1, old)
    if path[:1] == ("drive",):
        return drive_of_kind(scenario, kind)
    if path[:1] == ("motion",):
        return motion_of_kind(scenario, kind)
    form = next((form for form in forms.kinds if form.kind == kind), None)
    return {"kind": kind} if form is None else new_record(scenario, form.type, old)


def first_entries(scenario: Scenario, forms: Forms) -> list[dict[str, Any]]:
    """Return the entries of a list that stand for its omission, or none.

    A controller whose instruments are not listed has exact ones.
    """
    if not any(form.type is Instrument for form in forms.records):
        return []
    gauges = any(link.gauges for link in scenario.arm.links)
    return [{"signal": name} for name in ("joint_angle", "joint_rate", *["strain"] * gauges)]


def new_record(scenario: Scenario, record: type[Record], old: Any = None) -> dict[str, Any]:
    """Return starting values of a record, as a file has them; arguments as for `new_value`.

    Required fields without an entry in the table below start with simple values within their
    bounds.
    """
    fields = record.model_fields
    kind = kind_of(record)
    found = {} if kind is None else {"kind": kind}
    found |= _STARTS[record](scenario, old) if record in _STARTS else {}
    for name, field in fields.items():
        if field.is_required() and name not in found:
            length = 2 if name in record._columns else 1
            found[name] = _plain(scenario, forms_of(field).given[0], length)
    return found


def _plain(scenario: Scenario, form: Form, length: int, old: Any = None) -> Any:
    """Return a starting value of a form; ``length`` is that of a list."""
    if form.name == "record":
        return new_record(scenario, form.type, old)
    if form.name == "list":
        items = form.items().given[0]
        if items.name in ("record", "list"):
            return [_plain(scenario, items, 1) for _ in range(length)]
        return [_simple(items, k) for k in range(length)]
    if form.name == "names":
        return {"name": _plain(scenario, form.items().given[0], 1)}
    return _simple(form, 0)


def _simple(form: Form, k: int) -> Any:
    """Return the entry k of a list, or for 0 a single value."""
    if form.name == "number":
        return _number(form, k)
    values: dict[str, Any] = {"pair": [1.0 + k, 0.0], "flag": False, "word": f"name_{k + 1}"}
    return form.words[0] if form.name == "choice" else values[form.name]


def _number(form: Form, k: int) -> float:
    """Return 1, 2, ... if that is within the bounds, else numbers that are."""
    bounds = list(form.bounds())
    lowest = max((bound for bound, below, _ in bounds if below), default=0.0)
    highest = min((bound for bound, below, _ in bounds if not below), default=math.inf)
    usual = lowest < 1.0 + k < highest or lowest == 1.0 + k
    value = 1.0 + k if usual else lowest + (k + 1) / (k + 3) * (min(highest, lowest + 3.0) - lowest)
    return int(value) if form.type is int else value


def _stiffness(scenario: Scenario) -> float:
    """Return the stiffness (N/m) of the tip of the arm, stretched and clamped at the base."""
    links = scenario.arm.links
    found = [link.beam().flexural_rigidity for link in links if link.flexible]
    length = sum(link.reach for link in links)
    return 3.0 * min(table[0] for table in found if table) / length**3 if found else 1000.0


def _tips(scenario: Scenario) -> tuple[FloatArray, FloatArray, float]:
    """Return the tip (2,) m of the rigid arm at the ends of the motion, and its length (m)."""
    arm = Arm(scenario.arm).rigid()
    first, last = (arm.tip(arm.rest(angles))[:2] for angles in ends_of(arm, scenario))
    return first, last, sum(link.reach for link in scenario.arm.links)


def _load(scenario: Scenario, old: Any) -> dict[str, Any]:
    length = sum(link.reach for link in scenario.arm.links)
    force = short(_DEFLECTION * length * _stiffness(scenario))
    return {"link": len(scenario.arm.links), "force": [0.0, -force]}


def _change(scenario: Scenario, old: Any) -> dict[str, Any]:
    mass = scenario.arm.payload.mass
    half = short(0.5 * scenario.run.duration)
    return {"path": PAYLOAD_MASS, "at": half, "to": short(2.0 * mass or 0.1)}


def _number_of(old: Any) -> float:
    return old if isinstance(old, float) else 1.0


def _contact(scenario: Scenario, old: Any) -> dict[str, Any]:
    return {
        "surface": new_record(scenario, Wall),
        "stiffness": short(_HARDER * _stiffness(scenario)),
        "damping": 1.0,
    }


def _wall(scenario: Scenario, old: Any) -> dict[str, Any]:
    first, last, length = _tips(scenario)
    x = max(first[0], last[0], 0.0) + _SPACE * length
    return {"point": [short(x), 0.0], "normal": [-1.0, 0.0]}


def _post(scenario: Scenario, old: Any) -> dict[str, Any]:
    first, last, length = _tips(scenario)
    x, radius = max(first[0], last[0], 0.0) + 3.0 * _SPACE * length, 2.0 * _SPACE * length
    return {"center": [short(x), short(last[1])], "radius": short(radius)}


def _floor(scenario: Scenario, old: Any) -> dict[str, Any]:
    first, last, length = _tips(scenario)
    y = min(first[1], last[1], 0.0) - 2.0 * _SPACE * length
    return {"x": [short(k * length) for k in (-1, 0, 1)], "y": [short(y)] * 3}


def _limits(scenario: Scenario, old: Any) -> dict[str, Any]:
    ends = np.concatenate(ends_of(Arm(scenario.arm), scenario))
    bounds = {"lower": short(ends.min() - 0.5), "upper": short(ends.max() + 0.5)}
    return {**bounds, "stiffness": short(20.0 * _stiffness(scenario))}


def _hold(scenario: Scenario, old: Any) -> dict[str, Any]:
    numbers = Arm(scenario.arm).joint_numbers.tolist()
    if old is not None:
        return {"joint": old.joint}
    used = [joint.joint for joint in scenario.prescribed]
    return {"joint": next((k for k in numbers if k not in used), 1)}


def _tabulated(scenario: Scenario, old: Any) -> dict[str, Any]:
    arm, joint = Arm(scenario.arm), _hold(scenario, old)["joint"]
    numbers = arm.joint_numbers.tolist()
    place = numbers.index(joint) if joint in numbers else 0
    angles = [short(each[place]) for each in ends_of(arm, scenario)] if numbers else [0.0, 0.0]
    return {"joint": joint, "times": _times(scenario, 2), "angles": angles}


def _times(scenario: Scenario, count: int) -> list[float]:
    """Return times (s) from 0 to the end of the run."""
    return [short(t) for t in np.linspace(0.0, scenario.run.duration, count)]


def _joint_event(scenario: Scenario, old: Any) -> dict[str, Any]:
    arm = Arm(scenario.arm)
    first, last = ends_of(arm, scenario)
    angle = short(0.5 * (first[0] + last[0])) if arm.joints else 0.0
    return {"joint": next(iter(arm.joint_numbers.tolist()), 1), "angle": angle}


def _tip_event(scenario: Scenario, old: Any) -> dict[str, Any]:
    first, last, _ = _tips(scenario)
    away = last - first
    normal = away / np.linalg.norm(away) if away.any() else np.array([1.0, 0.0])
    middle = 0.5 * (first + last)
    return {"point": [short(v) for v in middle], "normal": [short(v) for v in normal]}


def _instrument(scenario: Scenario, old: Any) -> dict[str, Any]:
    hardware = scenario.hardware
    read = {item.label for item in (hardware and hardware.instruments) or ()}
    words = forms_of(Instrument.model_fields["signal"]).given[0].words
    return {"signal": next((word for word in words if word not in read), words[0])}


def _section(record: type[Record]) -> Callable[[Scenario, Any], dict[str, Any]]:
    """Return a function that returns a section as deep as the old one."""

    def start(scenario: Scenario, old: Any) -> dict[str, Any]:
        depth = getattr(old, "depth", 0.05)
        names = [name for name in record.model_fields if name != "kind"]
        return {name: short(0.1 * depth if name == "thickness" else depth) for name in names}

    return start


#: Starting values of fields of a record, for a scenario and the value to replace.
_STARTS: dict[type[Record], Callable[[Scenario, Any], dict[str, Any]]] = {
    Load: _load,
    FactorTable: lambda of, _: {"times": _times(of, 3), "values": [0.0, 1.0, 1.0]},
    AccelerationTable: lambda of, old: {
        "times": _times(of, 3),
        "values": [[0.0, 0.0], list(old or (1.0, 0.0)), [0.0, 0.0]],
    },
    ForceTable: lambda of, old: {"times": _times(of, 2), "values": [old or 1.0] * 2},
    Change: _change,
    ValueTable: lambda of, old: {"times": _times(of, 2), "values": [_number_of(old)] * 2},
    Contact: _contact,
    Wall: _wall,
    RoundWall: _post,
    SurfaceTable: _floor,
    Gauge: lambda of, _: {"station": 0.0, "distance": 0.005},
    Friction: lambda of, _: {"coulomb": 0.1},
    JointLimits: _limits,
    Winding: lambda of, _: {"torque_constant": 0.05, "resistance": 1.0},
    HeldJoint: _hold,
    FollowingJoint: _hold,
    TabulatedJoint: _tabulated,
    JointEvent: _joint_event,
    TipEvent: _tip_event,
    Instrument: _instrument,
    InstrumentFault: lambda of, _: {"kind": "bias", "size": 0.01},
    ModalDamping: lambda of, _: {"ratio": 0.01},
    RayleighDamping: lambda of, _: {"stiffness_coefficient": 0.001},
    SmoothingSpec: lambda of, _: {"duration": 0.1},
    **{record: _section(record) for record in (Rectangle, Circle, Tube, Box)},
}
