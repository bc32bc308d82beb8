"""Stability of the sampled loop of a run, with the arms that changes lead to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.control.analysis.linear_controller import FrozenReference
from flexarm.control.analysis.margins import ROUNDED_GROWTH, without_friction
from flexarm.control.analysis.sampled_loop import (
    PlantModel,
    instruments_of,
    loop_of,
    model_at,
    signals_of,
    sliding,
)
from flexarm.control.contract.base import Controller, Reference, has_poles
from flexarm.control.design.arm_scales import joint_sizes
from flexarm.control.design.rigid_model import values_of
from flexarm.control.hardware.measurement import FloatArray
from flexarm.control.hardware.sampled_plant import Signal
from flexarm.model import Contact, Hardware, Instrument
from flexarm.simulation.run.changes import ChangedArm

#: Inertias of a motor, relative to that of its link about the joint, that are tried as a cure.
_SHARES = (0.02, 0.1, 0.5)
#: Growth over the run below which an instability is ignored.
_NOTICED = 10.0
#: Least growth in a sample time that is certain. Errors of 1e-9 of the matrices move the double
#: pole of a joint that is damped only by up to 3e-5 in a sample time.
_CERTAIN = 5e-5
_OF_CONTACTS = ("contact_force", "contact_gap")
#: Angle (rad), or part of the reach, that joints move between the postures of a motion that are
#: analysed, the most of these postures, and number of times at which the motion is examined.
_APART, _MOST_PASSED, _LOOKED = 0.5, 3, 33
#: Growth (1/s), frequency (Hz) and magnitude of dominant poles, by the number of the arm, the time
#: of the posture (s) and its angles at the start.
Poles = dict[tuple[int, float, bytes], tuple[float, float, float]]


class LoopPole(NamedTuple):
    """The fastest growing, or slowest decaying, pole of a sampled loop at one posture."""

    when: str  # the time of the posture, in words
    growth: float  # 1/s; negative for a decay, zero if rounding may have caused it
    frequency: float  # Hz
    magnitude: float  # of the pole of the sampled loop
    begin: float  # s, of the part of the run in which the arm is simulated, or passes the posture
    end: float  # likewise
    passing: bool = False  # whether the motion passes the posture without a stop


class Stability(NamedTuple):
    """Stability of the loop of a run."""

    text: str  # description of an instability, or empty
    growth: float  # 1/s, the largest of all postures and arms; NaN if none is analysed
    slow: str = ""  # description of an instability that grows less than tenfold, or empty
    poles: Sequence[LoopPole] = ()  # those of `loop_poles`


class AnalysedLoop(NamedTuple):
    """Sampled loop of a run."""

    arm: Arm  # the controller's model of the plant
    plant: Arm
    controller: Controller
    reference: Reference | None
    hardware: Hardware | None
    contacts: Sequence[Contact]
    initial: FloatArray  # q (dof,) of the plant at the start
    duration: float  # of the run, s


def loop_poles(
    loop: AnalysedLoop, known: Poles | None = None, changed: Sequence[ChangedArm] = ()
) -> list[LoopPole]:
    """Return the dominant pole of the sampled loop at the start and at the end of a motion.

    Also at postures between them if the joints turn far, and with ``changed`` at the beginning of
    each changed arm. Equal arms are analysed once at each posture.

    Not analysed, and left out, are controllers that have no ``step``, cannot be copied
    or fail in the analysis.
    """
    plant, duration = loop.plant, loop.duration
    if not has_poles(loop.controller):
        return []
    instruments = instruments_of(plant, loop.hardware, len(loop.contacts))
    end = min(float(getattr(loop.reference, "end_time", 0.0) or 0.0), duration)
    first = ChangedArm(plant, 0.0, changed[0].begin if changed else duration, "")
    passed = _passed(plant, loop.reference, end)
    found, known, plants = [], {} if known is None else known, [plant]
    for part in (first, *changed):
        same = [k for k, other in enumerate(plants) if other.spec == part.plant.spec]
        number = same[0] if same else len(plants)
        plants += [] if same else [part.plant]
        for t, when, begin, until, passing in _times(part, end, passed):
            # After the start, the posture is that of the reference, which rests after its end.
            t = 0.0 if loop.reference is None else min(t, end) if end > 0.0 else t
            key = number, t, b"" if t > 0.0 else plant.joint_angles(loop.initial).tobytes()
            try:
                if key not in known:
                    with one_warning(report=False):  # the run itself warns of its states
                        known[key] = _worst(loop, plants[number], t, instruments)
            except (
                Exception
            ):  # the run itself reports a missing equilibrium or a failing controller
                continue
            found.append(LoopPole(when, *known[key], begin, until, passing))
    return found


def stability(
    loop: AnalysedLoop, known: Poles | None = None, changed: Sequence[ChangedArm] = ()
) -> Stability:
    """Analyse the sampled loop of a run, and name a change that makes an unstable one stable."""
    poles, sample_time = loop_poles(loop, known, changed), loop.controller.sample_time
    growth = max((pole.growth for pole in poles), default=np.nan)
    text = describe_instability(poles, sample_time)
    slow = describe_slow_instability(poles, sample_time, loop.duration)
    return Stability(f"{text} {_cure(loop)}".strip() if text else "", growth, slow, poles)


def _cure(loop: AnalysedLoop) -> str:
    """Return a sentence with a change that makes an unstable loop stable; empty if none does."""
    ignored = loop.hardware is not None and getattr(loop.controller, "hardware", loop) is None
    if ignored and _is_stable(loop._replace(hardware=None)):
        return "With ideal motors and instruments it is stable: design it with hardware=."
    for plant, inertia in with_inertia(loop.plant):
        if _is_stable(loop._replace(plant=plant)):
            return f"{NO_INERTIA} with {inertia} the loop is stable."
    return ""


def _is_stable(loop: AnalysedLoop) -> bool:
    poles = loop_poles(loop)
    return bool(poles) and max(pole.growth for pole in poles) <= 0.0


#: Begin of the sentence that names the inertia of motors as a cure.
NO_INERTIA = "The arm has no inertia of motors:"


def with_inertia(plant: Arm) -> Iterator[tuple[Arm, str]]:
    """Yield the arm with more and more inertia at its joints without any, and what they have.

    A torque on a flexible link without inertia of rotor or housing excites its fastest modes, which
    no sampled feedback of the joint damps. Nothing if every joint has both.
    """
    for share in _SHARES:
        joints, places, sizes = list(plant.spec.joints), [], []
        for i, (link, joint) in enumerate(zip(plant.spec.links, joints, strict=True)):
            beam = link.beam()
            squares = np.array(beam.mass_per_length) * np.square(beam.x)
            inertia = share * float(np.trapezoid(squares, beam.x))
            added = {}
            if not (joint.fixed or joint.hub_inertia or joint.rotor_inertia):
                added["hub_inertia"] = inertia
            if i > 0 and not (joint.fixed or joint.housing_inertia):
                added["housing_inertia"] = inertia
            if added and inertia > 0.0:
                joints[i] = joint.replace(**added)
                places.append(f"joints[{i}] {' and '.join(added)}")
                sizes.append(f"{inertia:.2g}")
        if places:
            text = f"{', '.join(places)} of {', '.join(sizes)} kg m^2"
            yield Arm(plant.spec.replace(joints=joints)), text


def describe_instability(poles: Sequence[LoopPole], sample_time: float) -> str:
    """Describe the first unstable one of the poles of `loop_poles`; empty if none is.

    An instability that grows less than tenfold is ignored. Its growth counts over the time of the
    arm, and that of changed arms in a row together; at a posture that the motion passes, over the
    time near it, and that of such postures in a row together.
    """
    lasting = [pole for pole in poles if not pole.passing]
    passing = [pole for pole in poles if pole.passing]
    return _grown(lasting, sample_time) or _grown(passing, sample_time)


def _grown(poles: Sequence[LoopPole], sample_time: float) -> str:
    """Describe the first unstable one of some poles; empty if none is."""
    grown, until = 0.0, 0.0  # exponents of the parts before, up to a time
    for (begin, end), poles_of_arm in groupby(poles, lambda pole: (pole.begin, pole.end)):
        poles_here = list(poles_of_arm)
        grown *= begin == until
        for pole in poles_here:
            if pole.growth > 0.0 and grown + pole.growth * (end - begin) > np.log(_NOTICED):
                return (
                    f"the sampled loop is unstable {pole.when}: a pole of magnitude "
                    f"{pole.magnitude:.4g} at {pole.frequency:.3g} Hz grows tenfold every "
                    f"{np.log(10.0) / pole.growth:.2g} s. Lower the gains or the sample time of "
                    f"{sample_time:g} s, or design for this arm; see docs/how-to/robust-loops.md."
                )
        most = max(pole.growth for pole in poles_here) * (end - begin)
        grown, until = max(grown + most, 0.0), end
    return ""


def describe_slow_instability(
    poles: Sequence[LoopPole], sample_time: float, duration: float
) -> str:
    """Describe the first pole that grows less than tenfold in a run; empty if none does.

    A run shows little of it, but a machine that works all day does.
    """
    for pole in poles:
        growth = pole.growth
        if growth * sample_time > _CERTAIN and growth * duration <= np.log(_NOTICED):
            return (
                f"the sampled loop is slowly unstable {pole.when}: a pole at "
                f"{pole.frequency:.3g} Hz grows tenfold every "
                f"{np.log(_NOTICED) / pole.growth:.2g} s, longer than the run of "
                f"{duration:g} s. Check the signs of gains and gauges; see "
                "docs/how-to/robust-loops.md."
            )
    return ""


def _times(
    part: ChangedArm, end: float, passed: Sequence[tuple[float, float, float]]
) -> list[tuple[float, str, float, float, bool]]:
    """Return times (s) and descriptions of the postures of an arm, in a motion up to ``end``.

    And the begin, the end and ``passing`` of each, as in `LoopPole`.
    """
    whole = part.begin, part.end
    times = [(part.begin, part.cause or "at the start", *whole, False)]
    cause = f", {part.cause}" if part.cause else ""
    if part.begin < end <= part.end:
        times.append((end, f"at the end of the motion{cause}", *whole, False))
    for begin, t, until in passed:
        if part.begin < t <= part.end:
            near = max(begin, part.begin), min(until, part.end)
            times.append((t, f"during the motion, at t = {t:.3g} s{cause}", *near, True))
    return times


def _passed(
    plant: Arm, reference: Reference | None, end: float
) -> list[tuple[float, float, float]]:
    """Return begin, middle and end (s) of the times near postures that a motion passes."""
    if reference is None or not 0.0 < end < np.inf:
        return []
    start = float(getattr(reference, "start_time", 0.0) or 0.0)
    times = np.linspace(min(start, end), end, _LOOKED)
    try:
        angles = values_of(reference, "joint_angle", times)
    except Exception:  # the run itself reports a failing reference
        return []
    moved = np.diff(angles, axis=0)
    turned = np.append(0.0, np.abs(moved / joint_sizes(plant)).max(axis=1).cumsum())
    count = min(int(turned[-1] / _APART), _MOST_PASSED)
    shares = turned[-1] * np.arange(2 * count + 1) / max(2 * count, 1)
    edges = np.interp(shares, turned, times)
    return [(edges[k - 1], edges[k], edges[k + 1]) for k in range(1, 2 * count, 2)]


def _worst(
    analysed: AnalysedLoop, plant: Arm, t: float, instruments: list[Instrument]
) -> tuple[float, float, float]:
    """Return growth (1/s), frequency (Hz) and magnitude of the fastest growing pole."""
    controller, reference, hardware = analysed.controller, analysed.reference, analysed.hardware
    contacts, initial = without_friction(analysed.contacts), analysed.initial
    rate, (arm, plant) = sliding(controller, reference, analysed.arm, plant)
    still = FrozenReference(reference, t) if reference is not None else None
    presses = bool(contacts) and hasattr(reference, "contact_force")
    angle = plant.joint_angles(initial)
    if reference is not None and (presses or t > 0.0):
        angle = np.asarray(reference.joint_angle(t))
    touched = contacts if presses else ()
    signals = signals_of(instruments)

    def model_of(simulated: Arm) -> PlantModel:
        free = [name for name in signals if touched or name not in _OF_CONTACTS]
        model = model_at(simulated, angle, free, touched)
        absent = {}
        for name in set(signals) - set(free):  # without contact these signals are zero
            size = len(contacts) * (2 if name == "contact_force" else 1)
            none = np.zeros((size, len(model.A))), np.zeros((size, simulated.n_joints))
            absent[name] = Signal(np.zeros(size), *none)
        return model._replace(signals=model.signals | absent)

    believed = model_of(arm) if arm is not plant and len(arm.gauges) == len(plant.gauges) else None
    loop = loop_of(controller, model_of(plant), instruments, hardware, still, t, believed, rate)
    multipliers = loop.multipliers()
    # An integral that no torque depends on keeps its value: this is not a motion of the loop.
    moving = multipliers[np.abs(multipliers - 1.0) > ROUNDED_GROWTH]
    z = moving[0] if moving.size else multipliers[0]
    pole = np.log(z) / loop.sample_time
    growth = float(pole.real) if abs(pole.real) * loop.sample_time > ROUNDED_GROWTH else 0.0
    return growth, float(abs(pole.imag)) / (2.0 * np.pi), float(abs(z))
