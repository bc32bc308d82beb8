"""Summary of arms and scenarios in a few lines, for commands and reports."""

from __future__ import annotations

from collections.abc import Sequence

from flexarm.arm.arm import Arm
from flexarm.model import AccelerationTable, Hardware, Instrument, Scenario, Sensor
from flexarm.model.checks import Record, leaves
from flexarm.model.scenarios import motions
from flexarm.model.scenarios.scenario import recording_rate
from flexarm.simulation.run.channels import CHANNELS

_MOST_LINKS_SHOWN = 12
#: Fields of an instrument that its label shows.
_NAMES = ("signal", "name")
_SURFACES = {"wall": "wall", "round": "circle", "table": "tabulated surface"}


def about_arm(arm: Arm) -> list[tuple[str, str]]:
    """Return names and values that describe an arm: its size, its links and its payload."""
    spec = arm.spec
    gx, gy = spec.gravity
    gravity = f"gravity ({gx:g}, {gy:g}) m/s^2" if gx or gy else "no gravity"
    theory = spec.theory.replace("_", "-")
    size = f"{_count(arm.n_links, 'link')}, {_count(arm.dof, 'coordinate')}"
    rows = [("arm", f"{size}, {theory} theory, {gravity}")]
    for number, link in enumerate(spec.links, start=1):
        if number > _MOST_LINKS_SHOWN:
            rows.append(("", f"... and {arm.n_links - _MOST_LINKS_SHOWN} more links"))
            break
        bends = f"{_count(link.elements, 'element')}, {_count(link.coordinates, 'mode')}"
        if link.segments > 1:
            bends = f"{_count(link.segments, 'segment')}, {bends}"
        bends = bends if link.flexible else "rigid"
        mass = sum(piece.shapes.mass for piece in arm.assembly.pieces_of(number - 1))
        rows.append((f"link {number}", f"{link.reach:g} m, {mass:.4g} kg, {bends}"))
    if spec.payload.mass or spec.payload.inertia:
        rows.append(("payload", f"{spec.payload.mass:g} kg, {spec.payload.inertia:g} kg m^2"))
    return rows


def about_run(scenario: Scenario) -> list[tuple[str, str]]:
    """Return names and values that describe a scenario, without its arm."""
    rows = []
    motion = scenario.motion
    presses = isinstance(motion, motions.PressedMotionSpec)
    if isinstance(motion, motions.PressedMotionSpec):
        motion = motion.path
    if motion is not None:
        rows.append(("motion", f"{_way(motion)}{', pressing' if presses else ''}"))
    run = scenario.run
    rows.append(("drive", scenario.drive.kind.replace("_", " ")))
    hardware = scenario.hardware or Hardware()
    for instrument in hardware.instruments or ():
        unit = _unit_read(instrument)
        rows.append(("instrument", f"{instrument.label}: {_given(instrument, unit) or 'exact'}"))
    if hardware.motors is not None:
        rows.append(("motors", _given(hardware.motors) or "ideal"))
    for joint in scenario.prescribed:
        rows.append((f"joint {joint.joint}", f"prescribed: {joint.kind}"))
    for load in scenario.loads:
        rows.append(("load", f"on link {load.link}{' over time' if load.factor else ''}"))
    for event in scenario.events:
        ends = ", ends the run" if event.terminal else ""
        rows.append(("event", f"{event.kind.replace('_', ' ')}{ends}"))
    for contact in scenario.contacts:
        link = contact.link or len(scenario.arm.links)
        rows.append(("contact", f"of link {link} with a {_SURFACES[contact.surface.kind]}"))
    if scenario.base_acceleration is not None:
        over_time = isinstance(scenario.base_acceleration, AccelerationTable)
        rows.append(("base", f"accelerates{' over time' if over_time else ''}"))
    if scenario.initial.equilibrium:
        balanced = ", the drive balanced" if scenario.initial.balance else ""
        rows.append(("start", f"in equilibrium{balanced}"))
    rate = recording_rate(run.rate, run.duration)
    rows.append(("run", f"{run.duration:g} s, {rate:g} samples/s, integrator {run.integrator}"))
    return rows


def _way(motion: motions.PlainMotionSpec) -> str:
    changed = [name for name in ("shaping", "smoothing") if getattr(motion, name) is not None]
    also = "".join(f", with {name}" for name in changed)
    match motion:
        case motions.JointMotionSpec():
            return f"joints, in {motion.duration:g} s{also}"
        case motions.LineMotionSpec():
            path = f"line from {_point(motion.start)} to {_point(motion.end)} m"
        case motions.CircleMotionSpec():
            path = f"circle about {_point(motion.center)} m by {motion.angle:g} rad"
        case _:
            ends = f"{_point(motion.points[0])} to {_point(motion.points[-1])} m"
            kind = motion.kind.replace("_", " ")
            path = f"{kind} from {ends}, {len(motion.points)} points"
    return f"{path} in {motion.duration:g} s, within reach{also}"


def _unit_read(instrument: Instrument) -> str:
    """Return the unit of the readings of an instrument."""
    signal = instrument.output
    return signal.unit if isinstance(signal, Sensor) else CHANNELS[signal].unit


def _given(record: Record, unit: str = "") -> str:
    """Return the numbers of a record that a user gave; ``unit`` is that of a field without one."""
    texts = []
    for name, value, of_field in leaves(record, ""):
        text, label = str(value), of_field
        if isinstance(value, float):
            text, label = f"{value:g}", of_field or unit
        if name not in _NAMES:
            texts.append(f"{name} {text} {'' if label == '1' else label}".rstrip())
    return ", ".join(texts)


def _point(point: Sequence[float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"


def _count(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"
