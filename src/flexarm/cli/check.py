"""``flexarm check``: read and validate a file, and print a summary of its content."""

from __future__ import annotations

from pathlib import Path

from flexarm.arm import Arm
from flexarm.cli.advice import about_integrator, about_prepared, about_vibration
from flexarm.cli.failures import warn
from flexarm.cli.tables import console, facts
from flexarm.errors import ModelError
from flexarm.model import (
    AccelerationTable,
    Scenario,
    Study,
    load_arm_spec,
    locate_scenario,
    locate_study,
)
from flexarm.model.files import load_document
from flexarm.model.motions import (
    CircleMotionSpec,
    JointMotionSpec,
    LineMotionSpec,
    PlainMotionSpec,
    PressedMotionSpec,
)
from flexarm.model.yaml_text import Document
from flexarm.scenarios.file_errors import Where
from flexarm.scenarios.scenario import prepare
from flexarm.scenarios.study import PreparedStudy

_MOST_LINKS_SHOWN = 12


def check_file(path: Path) -> None:
    """Check an arm file, a scenario with its motion, or a study, and print a summary.

    Raises:
        InputError: if the file is not valid; it lists every problem.
    """
    document = load_document(path)
    is_study = "drives" in document.value
    located = None if is_study else _scenario(document)
    unstable: list[str] = []
    if is_study:
        study = PreparedStudy(*locate_study(document))
        unstable = [f"{name}: {text}" for name, text in study.unstable_loops().items()]
        found = [*_about_arm(study.arm), *_about_study(study.study), *about_vibration(study.arm)]
    elif located is None:
        arm = Arm(load_arm_spec(document))
        found = [*_about_arm(arm), *about_vibration(arm), *about_integrator(arm)]
    else:
        scenario, where = located
        prepared = prepare(scenario, where)
        poles = prepared.loop_poles()
        unstable = list(filter(None, [prepared.unstable_loop(poles)]))
        found = [*_about_arm(prepared.arm), *_about_run(scenario), *about_prepared(prepared, poles)]
    screen = console()
    screen.print(facts(found))
    for text in unstable:
        warn(text)
    screen.print("ok, but for the warning" if unstable else "ok")


def _about_study(study: Study) -> list[tuple[str, str]]:
    names = (("drives", study.drives), ("plants", study.plants), ("motions", study.motions))
    rows = [(kind, ", ".join(list(items))) for kind, items in names]
    runs = len(study.drives) * len(study.plants) * len(study.motions)
    return [*rows, ("runs", f"{runs} of {study.run.duration:g} s")]


def _scenario(document: Document) -> tuple[Scenario, Where] | None:
    """Read a scenario, see `locate_scenario`; return None if the file describes only an arm."""
    try:
        return locate_scenario(document)
    except ModelError as error:
        if all((problem.name, problem.value) != ("run", "missing") for problem in error.problems):
            raise
        # A missing run means an arm file or an incomplete scenario; the other keys decide.
        if document.value.keys() <= {"flexarm", "arm"}:
            return None
        raise


def _about_arm(arm: Arm) -> list[tuple[str, str]]:
    spec = arm.spec
    gx, gy = spec.gravity
    gravity = f"gravity ({gx:g}, {gy:g}) m/s^2" if gx or gy else "no gravity"
    theory = spec.theory.replace("_", "-")
    size = f"{_count(arm.links, 'link')}, {_count(arm.dof, 'coordinate')}"
    rows = [("arm", f"{size}, {theory} theory, {gravity}")]
    for number, link in enumerate(spec.links, start=1):
        if number > _MOST_LINKS_SHOWN:
            rows.append(("", f"... and {arm.links - _MOST_LINKS_SHOWN} more links"))
            break
        bends = f"{_count(link.elements, 'element')}, {_count(link.coordinates, 'mode')}"
        if link.segments > 1:
            bends = f"{_count(link.segments, 'segment')}, {bends}"
        bends = bends if link.flexible else "rigid"
        mass = sum(piece.shapes.mass for piece in arm.assembly.pieces_of(number - 1))
        rows.append((f"link {number}", f"{link.length:g} m, {mass:.4g} kg, {bends}"))
    if spec.payload.mass or spec.payload.inertia:
        rows.append(("payload", f"{spec.payload.mass:g} kg, {spec.payload.inertia:g} kg m^2"))
    return rows


def _about_run(scenario: Scenario) -> list[tuple[str, str]]:
    rows = []
    motion = scenario.motion
    presses = isinstance(motion, PressedMotionSpec)
    if isinstance(motion, PressedMotionSpec):
        motion = motion.path
    if motion is not None:
        rows.append(("motion", f"{_way(motion)}{', pressing' if presses else ''}"))
    run = scenario.run
    rows.append(("drive", scenario.drive.kind.replace("_", " ")))
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
    rows.append(("run", f"{run.duration:g} s, {run.rate:g} samples/s, integrator {run.integrator}"))
    return rows


def _way(motion: PlainMotionSpec) -> str:
    changed = [name for name in ("shaping", "smoothing") if getattr(motion, name) is not None]
    also = "".join(f", with {name}" for name in changed)
    match motion:
        case JointMotionSpec():
            return f"joints, in {motion.duration:g} s{also}"
        case LineMotionSpec():
            path = f"line from {_point(motion.start)} to {_point(motion.end)} m"
        case CircleMotionSpec():
            path = f"circle about {_point(motion.center)} m by {motion.angle:g} rad"
        case _:
            ends = f"{_point(motion.points[0])} to {_point(motion.points[-1])} m"
            kind = motion.kind.replace("_", " ")
            path = f"{kind} from {ends}, {len(motion.points)} points"
    return f"{path} in {motion.duration:g} s, within reach{also}"


def _point(point: tuple[float, float]) -> str:
    return f"({point[0]:g}, {point[1]:g})"


_SURFACES = {"wall": "wall", "round": "circle", "table": "tabulated surface"}


def _count(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"
