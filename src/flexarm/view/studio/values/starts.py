"""Starting values: a run for an arm alone, another motion or drive, new records."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.errors import FlexarmError
from flexarm.cases.scenario.references import motion_of
from flexarm.control.design.arm_scales import arm_scales
from flexarm.linear import assembled, modes
from flexarm.model import ArmSpec, Instrument, InstrumentFault, Scenario, environment, surfaces
from flexarm.model.arm.joints import Friction, JointLimits, Winding
from flexarm.model.arm.links import (
    Box,
    Circle,
    Gauge,
    ModalDamping,
    RayleighDamping,
    Rectangle,
    Tube,
)
from flexarm.model.checks import Record, descriptions_of
from flexarm.model.drives import DRIVES, TorqueDrive
from flexarm.model.file_format.files import content_of
from flexarm.model.scenarios.motions import ForceTable, SmoothingSpec
from flexarm.model.scenarios.scenario import (
    FollowingJoint,
    HeldJoint,
    JointEvent,
    TabulatedJoint,
    TipEvent,
)
from flexarm.model.units import unit_of
from flexarm.model.wording import Path
from flexarm.motion import Motion, rigid_torque
from flexarm.view.studio.values.forms import Form, Forms, forms_of, kind_of

_DURATION, _ANGLE = 2.0, 0.5


def scenario_around(arm: ArmSpec) -> Scenario:
    """Return a scenario of an arm: all joints turn, by the torques of the rigid arm.

    Closed loops start near bent angles, and joint 1 pushes them.
    """
    model = Arm(arm)
    joints = model.n_joints
    if arm.closures:
        guess = model.rest(_ANGLE * (-1.0) ** np.arange(joints))
        angles = [short(v) for v in model.joint_angles(assembled(model, guess).q)]
        initial = {"joint_angle": angles, "joint_rate": [1.0, *[0.0] * (joints - 1)]}
        return Scenario(arm=arm, initial=initial, run={"duration": 1.5 * _DURATION})  # type: ignore[arg-type]
    motion = _joints(np.zeros(joints), np.full(joints, _ANGLE)) if joints else None
    drive = {"kind": "rigid_inverse_dynamics" if joints else "none"}
    run = {"duration": 1.5 * _DURATION}
    return Scenario(arm=arm, motion=motion, drive=drive, run=run)  # type: ignore[arg-type]


def motion_of_kind(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return a motion of a kind between the ends of the scenario's motion."""
    # The arm's own joints turn by half a radian if the scenario has no motion. A kind without
    # starting values is returned alone, so that the records report what is wrong.
    arm = Arm(scenario.arm)
    start, end = ends_of(arm, scenario)
    if kind == "joint":
        return _joints(start, end) | _timing(scenario)
    if kind == "pressed":
        path = scenario.motion
        plain = path is not None and path.kind != "pressed"
        inner = content_of(path) if plain else motion_of_kind(scenario, "line")
        normal = {} if scenario.contacts else {"normal": [-1.0, 0.0]}
        return {"kind": kind, "path": inner, "force": 1.0, **normal}
    rigid = arm.rigid()
    first, last = (rigid.tip(rigid.rest(angles))[:2] for angles in (start, end))
    middle = 0.5 * (first + last) + 0.1 * np.array([1.0, -1.0]) * (last - first)[::-1]
    turn = round(2 * np.pi, 4)
    shapes: dict[str, Callable[[], dict[str, Any]]] = {
        "line": lambda: {"start": _point(first), "end": _point(last)},
        "circle": lambda: {"center": _point(0.9 * first), "start": _point(first), "angle": turn},
        "spline": lambda: {"points": [_point(first), _point(middle), _point(last)]},
        "via_points": lambda: {"points": [_point(first), _point(middle), _point(last)]},
    }
    if kind not in shapes:
        return {"kind": kind}
    return {"kind": kind, **shapes[kind]()} | _timing(scenario)


def ends_of(arm: Arm, scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Return the joint angles (joints,) rad at the start and at the end of the motion."""
    try:
        motion: Any = motion_of(arm, scenario)
        if motion is not None:
            return np.asarray(motion.joint_angle(0.0)), np.asarray(motion.joint_angle(1e9))
    except FlexarmError:  # the motion leaves the reach: start anew
        pass
    return np.full(arm.n_joints, 0.3), np.full(arm.n_joints, 0.3 + _ANGLE)


def _joints(start: FloatArray, end: FloatArray) -> dict[str, Any]:
    ends = {name: [short(v) for v in values] for name, values in (("start", start), ("end", end))}
    return {"kind": "joint", **ends, "duration": _DURATION}


def _timing(scenario: Scenario) -> dict[str, Any]:
    motion = getattr(scenario.motion, "path", scenario.motion)
    return {"duration": getattr(motion, "duration", _DURATION)}


def _point(point: FloatArray) -> list[float]:
    return [round(float(v), 4) + 0.0 for v in point]


def short(value: float) -> float:
    """Round to three digits."""
    return float(f"{float(value) + 0.0:.3g}")


#: Largest static deflection of the arm by the force of a new load, relative to its length, and
#: stiffness of a new surface relative to that of the arm.
_DEFLECTION, _HARDER = 0.02, 1000.0
#: Free space between the tip and a new surface, relative to the length of the arm.
_SPACE = 0.05


def new_value(
    scenario: Scenario, path: Path, forms: Forms, kind: str | None = None, old: Any = None
) -> Any:
    """Return a starting value in a scenario instead of ``old``, as a file has it."""
    # A kind that does not exist is returned alone, so that the records report what is wrong.
    if kind is None:
        return _plain(scenario, forms.given[0], 1, old)
    if path[:1] == ("drive",):
        return drive_of_kind(scenario, kind)
    if path[:1] == ("motion",):
        return motion_of_kind(scenario, kind)
    form = next((form for form in forms.kinds if form.kind == kind), None)
    return {"kind": kind} if form is None else new_record(scenario, form.type, old)


def first_entries(scenario: Scenario, forms: Forms) -> list[dict[str, Any]]:
    """Return the entries of a list that stand for its omission, or none."""
    if not any(form.type is Instrument for form in forms.records):
        return []
    gauges = any(link.gauges for link in scenario.arm.links)
    return [{"signal": name} for name in ("joint_angle", "joint_rate", *["strain"] * gauges)]


def new_record(scenario: Scenario, record: type[Record], old: Any = None) -> dict[str, Any]:
    """Return starting values of a record; required fields without an entry get simple ones."""
    fields = record.model_fields
    kind = kind_of(record)
    content = {} if kind is None else {"kind": kind}
    content |= _STARTS[record](scenario, old) if record in _STARTS else {}
    for name, field in fields.items():
        if field.is_required() and name not in content:
            length = 2 if name in record._columns else 1
            content[name] = _plain(scenario, forms_of(field).given[0], length)
    return content


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
        bounds = list(form.bounds())
        lowest = max((bound for bound, below, _ in bounds if below), default=0.0)
        highest = min((bound for bound, below, _ in bounds if not below), default=math.inf)
        usual = lowest < 1.0 + k < highest or lowest == 1.0 + k
        value = (
            1.0 + k if usual else lowest + (k + 1) / (k + 3) * (min(highest, lowest + 3.0) - lowest)
        )
        return int(value) if form.type is int else value
    values: dict[str, Any] = {"pair": [1.0 + k, 0.0], "flag": False, "word": f"name_{k + 1}"}
    return form.words[0] if form.name == "choice" else values[form.name]


def _stiffness(scenario: Scenario) -> float:
    """Return the stiffness (N/m) of the tip of the arm, stretched and clamped at the base."""
    links = scenario.arm.links
    rigidities = [link.beam().flexural_rigidity for link in links if link.flexible]
    if not rigidities:
        return 1000.0
    length = sum(link.reach for link in links)
    return 3.0 * min(table[0] for table in rigidities if table) / length**3


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
    return {"path": environment.PAYLOAD_MASS, "at": half, "to": short(2.0 * mass or 0.1)}


def _contact(scenario: Scenario, old: Any) -> dict[str, Any]:
    return {
        "surface": new_record(scenario, surfaces.Wall),
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
    angle = short(0.5 * (first[0] + last[0])) if arm.n_joints else 0.0
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
    environment.Load: _load,
    environment.FactorTable: lambda of, _: {"times": _times(of, 3), "values": [0.0, 1.0, 1.0]},
    environment.AccelerationTable: lambda of, old: {
        "times": _times(of, 3),
        "values": [[0.0, 0.0], list(old or (1.0, 0.0)), [0.0, 0.0]],
    },
    ForceTable: lambda of, old: {"times": _times(of, 2), "values": [old or 1.0] * 2},
    environment.Change: _change,
    environment.ValueTable: lambda of, old: {
        "times": _times(of, 2),
        "values": [old if isinstance(old, float) else 1.0] * 2,
    },
    environment.Contact: _contact,
    surfaces.Wall: _wall,
    surfaces.RoundWall: _post,
    surfaces.SurfaceTable: _floor,
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


#: Bandwidth of a joint loop, as a fraction of the lowest frequency with locked joints, and rad/s
#: for a rigid arm.
_BANDWIDTH, _RIGID_BANDWIDTH = 0.4, 5.0
_DAMPING = 0.7
_SAMPLE_TIME = 0.001
#: Limit on the change of a joint rate in one sample by its own rate gain.
_RATE_STEP = 0.3
#: Limit on a sample time, in periods of the highest of two modes a link.
_HELD = 0.1
#: Intervals of a sampled torque.
_INTERVALS = 20


@dataclass(frozen=True, eq=False)
class _Design:
    """What starting gains depend on: the arm, and the ends of its motion."""

    scenario: Scenario

    @cached_property
    def arm(self) -> Arm:
        """The arm, created when the kind of drive depends on it."""
        return Arm(self.scenario.arm)

    @cached_property
    def ends(self) -> tuple[FloatArray, FloatArray]:
        """Joint angles (joints,) rad at the start and at the end."""
        return ends_of(self.arm, self.scenario)

    @cached_property
    def motion(self) -> Motion | None:
        """The motion, if there is one that does not press and is within reach."""
        try:
            motion = motion_of(self.arm, self.scenario)
        except FlexarmError:
            return None
        return motion if isinstance(motion, Motion) else None

    @property
    def instruments(self) -> bool:
        """Whether the hardware has instruments."""
        hardware = self.scenario.hardware
        return hardware is not None and bool(hardware.instruments)

    @cached_property
    def frequencies(self) -> FloatArray:
        """Frequencies (Hz) of two modes a link, with locked joints."""
        frequencies = modes(self.arm, self.ends[0]).frequency_hz
        return np.asarray(frequencies[frequencies > 0.0][: 2 * self.arm.n_links])

    @cached_property
    def bandwidth(self) -> float:
        """Bandwidth of a joint loop, rad/s."""
        lowest = self.frequencies[:1]
        return float(_BANDWIDTH * 2.0 * np.pi * lowest[0]) if lowest.size else _RIGID_BANDWIDTH

    @cached_property
    def inertia(self) -> FloatArray:
        """Rotary inertia (joints,) kg m^2 at each joint of the rigid arm."""
        rigid = self.arm.rigid()
        return np.diag(rigid.mass_matrix(rigid.rest(self.ends[0])))[rigid.joint_index]

    @cached_property
    def derivative(self) -> FloatArray:
        """Torque per rate error (joints,) N m s/rad."""
        arm = self.arm
        # A light flexible link beside a joint accelerates faster than the inertia suggests.
        mass = arm.mass_matrix(arm.rest(self.ends[0]))
        quickest = np.diag(np.linalg.inv(mass))[arm.joint_index]
        usual = 2.0 * _DAMPING * self.inertia * self.bandwidth
        return np.minimum(usual, _RATE_STEP / (quickest * _SAMPLE_TIME))

    @cached_property
    def slowest(self) -> float:
        """Natural frequency (rad/s) of the joint loop with the smallest rate gain."""
        return float(np.min(self.derivative / self.inertia)) / (2.0 * _DAMPING)

    def usual(self, record: Any, name: str) -> Any:
        """Return a value of a required parameter: a number that is usual for its unit here."""
        field = record.model_fields[name]
        form, unit = forms_of(field).given[0], unit_of(descriptions_of(record).get(name, ""))
        size = arm_scales(self.arm, self.bandwidth).size(unit)
        fits = all(size > bound if below else size < bound for bound, below, _ in form.bounds())
        value = short(size) if unit and fits else _plain(self.scenario, form, 1)
        return self.each(value) if name in getattr(record, "per_joint", ()) else value

    def each(self, values: Any) -> list[float]:
        """Return values (joints,) with three digits."""
        return [short(value) for value in np.broadcast_to(values, self.inertia.shape)]


#: Starting value of a parameter for its default, which is None if the parameter is required; None
#: keeps the default.
_Start = Callable[[_Design, Any], Any]


def _if_required(start: Callable[[_Design], Any]) -> _Start:
    return lambda of, default: start(of) if default is None else None


def _at_most(start: Callable[[_Design], float]) -> _Start:
    return lambda of, default: short(min(start(of), math.inf if default is None else default))


#: Starting values by the name of a parameter. Others start with their default, or a number that is
#: usual for their unit.
_GAIN_STARTS: dict[str, _Start] = {
    "proportional": lambda of, _: of.each(of.derivative * of.bandwidth / (2.0 * _DAMPING)),
    "derivative": lambda of, _: of.each(of.derivative),
    "damping": _if_required(lambda of: of.each(of.derivative)),
    "frequency_hz": lambda of, _: short(of.slowest / (2.0 * np.pi)),
    "frequency": _at_most(lambda of: of.slowest),
    "posture_frequency": _at_most(lambda of: of.slowest),
    "bandwidth": _if_required(lambda of: 0.5 * of.slowest),
    "cutoff": _at_most(lambda of: of.slowest / (2.0 * np.pi)),
    # A linear model of one posture is wrong at others, by more the longer its torque is held.
    "sample_time": _at_most(lambda of: _HELD / max(of.frequencies, default=_HELD)),
    "damping_ratio": _at_most(lambda of: _DAMPING),
    "boundary_layer": lambda of, _: 0.5,
    "bound": lambda of, _: 0.2,
    "rate_bound": lambda of, _: 2.0,
    "adaptation": lambda of, _: 0.001,
    "strain": lambda of, _: 0.0,
    "torque_limit": _if_required(lambda of: of.each(20.0 * of.inertia)),
    "lower": lambda of, _: of.each(np.minimum(*of.ends) - 0.2),
    "upper": lambda of, _: of.each(np.maximum(*of.ends) + 0.2),
    "posture": lambda of, _: of.each(0.5 * (of.ends[0] + of.ends[1])),
    "period": _if_required(lambda of: max(1.0, short(20.0 * np.pi / of.slowest))),
    # Without a payload an uncertainty of it is a warning. Without damping a tenth of the rigidity
    # leaves a loop of mu synthesis unstable; exact rigidities may have no solution.
    "payload_uncertainty": lambda of, _: None if of.arm.spec.payload.mass else 0.0,
    "rigidity_uncertainty": lambda of, default: 0.01 if 0.0 < default < 1.0 else None,
    "inner": lambda of, _: drive_of_kind(of.scenario, "joint_pd"),
    "estimator": lambda of, _: None if of.instruments else {"instruments": _instruments(of.arm)},
}


def drive_of_kind(scenario: Scenario, kind: str) -> dict[str, Any]:
    """Return a drive with gains well below the vibration of the arm; of unknown kind, alone."""
    records = {form.model_fields["kind"].default: form for form in chain(*DRIVES.values())}
    content: dict[str, Any] = {"kind": kind}
    if kind not in records:
        return content
    of = _Design(scenario)
    if records[kind] is TorqueDrive:
        return content | _sampled(of)
    for name, field in records[kind].model_fields.items():
        default = None if field.is_required() else field.default
        # A controller derives its own damping from the arm if it is not required.
        starts = name in _GAIN_STARTS and (name != "damping" or field.is_required())
        value = _GAIN_STARTS[name](of, default) if starts else None
        if name not in _GAIN_STARTS and field.is_required():
            value = of.usual(records[kind], name)
        if value is not None:
            content[name] = value
    return content


def _instruments(arm: Arm) -> list[dict[str, Any]]:
    instruments = [{"signal": "joint_angle", "noise": 1e-4}]
    gauges = any(link.gauges for link in arm.spec.links)
    return [*instruments, {"signal": "strain", "noise": 1e-6}] if gauges else instruments


def _sampled(of: _Design) -> dict[str, Any]:
    """Return samples of the torque of the rigid arm along the motion."""
    motion, joints = of.motion, of.arm.n_joints
    if motion is None:
        return {"rate": 10.0, "values": [[0.0] * joints] * 2}
    torque = rigid_torque(of.arm, motion)
    rate = short(_INTERVALS / motion.end_time)
    times = np.arange(_INTERVALS + 2) / rate
    return {"rate": rate, "values": [[short(each) for each in torque(t)] for t in times]}
