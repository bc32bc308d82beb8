"""Limits that a run reaches: of motors, instruments, joint stops, contacts and references."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes, turning_joints
from flexarm.arm.bending import theory_error
from flexarm.arm.observe import contact_values
from flexarm.base.errors import (
    AccuracyWarning,
    FlexarmError,
    LargeDeflectionWarning,
    LimitWarning,
    without_warnings,
)
from flexarm.base.late import xr
from flexarm.control.contract.base import Controller, Reference, around
from flexarm.control.hardware.measurement import Readings
from flexarm.integrate.base import FloatArray
from flexarm.kernels.forces.contact import GAP, SURFACE
from flexarm.kernels.forces.surface import CURVATURE
from flexarm.kernels.layout import Contacts
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.motion import Motion
from flexarm.simulation.calls.metrics import length_text, reference_angles, tip_reference
from flexarm.simulation.calls.result import channel_labels
from flexarm.simulation.loop.control_loop import ClosedLoop
from flexarm.simulation.run.channels import LIMITS
from flexarm.simulation.run.stepping import Notices, Run
from flexarm.simulation.run.validity import axial_loads

BoolArray = NDArray[np.bool_]
#: Growth of an angle error at a limit of the motor that is reported, as a fraction of the largest
#: of the travel of the joint, its first error, a tenth of the travel of all joints, and for a joint
#: that holds its angle, of a tenth of a radian or of the reach. A motion that is too fast for its
#: motors lags by less, and a bounded overshoot is smaller, but the integral of a saturated loop
#: winds up.
_GROWN, _OF_ALL, _HELD = 0.5, 0.1, 0.1
#: Share of the frames of an instrument at its limit that is reported. A sensor of a gap is at its
#: limit whenever the surface is far.
_BLIND = 0.1
#: Depth in a stop that is reported: fraction of the range of the joint, between two angles (rad) or
#: fractions of the reach. Depth of a contact that is reported: fractions of the reach, and of the
#: radius of a post.
_OF_RANGE, _TURNED, _OF_REACH, _OF_RADIUS = 0.25, (0.1, 0.35), 0.1, 0.5
#: Error of the tip at rest in which the sag is looked for, as a fraction of the reach, and fewest
#: samples at rest.
_SAGGING, _RESTING = 1e-3, 10
#: Stride of the samples that are examined before all are.
_STRIDE = 8


def motor_numbers(since: FloatArray, saturated: BoolArray, end: float) -> dict[str, FloatArray]:
    """Return the share of the time that motors are at a limit, and the longest time there."""
    shape = (-1, *(1,) * (saturated.ndim - 1))
    ends = np.append(since[1:], end).reshape(shape)
    lasting = ends - since.reshape(shape)
    free_until = np.maximum.accumulate(np.where(saturated, 0.0, ends), axis=0)
    longest = ((ends - free_until) * saturated).max(axis=0)
    # A cumulative sum rounds alike for one run and for many.
    share = np.cumsum(lasting * saturated, axis=0)[-1] / max(end, np.finfo(float).tiny)
    return {"saturation": share, "longest_saturation": longest}


def motor_warning(
    arm: Arm,
    controller: Controller,
    reference: Reference | None,
    times: FloatArray,
    angle: FloatArray,
    limits: tuple[FloatArray, BoolArray],
    numbers: Mapping[str, FloatArray],
) -> str:
    """Describe the motor whose limit does the most harm; empty if none does.

    Harm is an angle error that grows by much while the motor is at its limit, or that stays large
    because the motor does not leave it.
    """
    since, saturated = limits
    if reference is None or not saturated.any() or len(times) < 2:
        return ""
    wanted = reference_angles(reference, times, arm.n_joints)
    error = np.abs(angle - wanted)
    end = float(getattr(reference, "end_time", 0.0) or 0.0)
    goal = [np.asarray(reference.joint_angle(end))] if 0.0 < end < np.inf else []
    travel = np.ptp(np.vstack([wanted, *goal]), axis=0)  # also of a motion that the run cuts
    size = np.maximum(np.maximum(travel, error[0]), _OF_ALL * travel.max())
    held = _HELD * coordinate_sizes(arm)[arm.joint_index]
    size = np.maximum(size, np.where(travel > 0.0, 0.0, held))
    place = np.searchsorted(since, times * (1.0 + 1e-12), side="right") - 1
    harm = [
        _harm(error[:, j], saturated[place, j]) if saturated[:, j].any() else 0.0
        for j in range(arm.n_joints)
    ]
    worst = int(np.argmax(np.array(harm) / size))
    if not harm[worst] > _GROWN * size[worst]:
        return ""
    number, share = arm.joint_numbers[worst], float(numbers["saturation"][worst])
    longest = float(numbers["longest_saturation"][worst])
    return (
        f"motor {number} is at its limit for {share:.0%} of the run, up to {longest:.3g} s at a "
        f"time, and the error of its joint reaches {error[:, worst].max():.3g} "
        f"{'rad' if turning_joints(arm)[worst] else 'm'}: "
        f"{_cure(controller)}; see docs/how-to/sense-and-act.md."
    )


def _cure(controller: object) -> str:
    laws, cure = list(around(controller)), "use a slower motion or a stronger motor"
    knowing = any(getattr(law, "knows_limits", False) for law in laws)
    own = Controller.initial_memory
    if knowing or all(getattr(type(law), "initial_memory", None) is own for law in laws):
        return cure
    return f"{cure}, and an integral that stops at the limit, as that of fa.JointPID"


def _harm(error: FloatArray, saturated: BoolArray) -> float:
    """Return the largest growth (rad) of an error within a saturated interval, or what is left.

    What is left counts if the last interval is half of the run and the error does not decrease.
    """
    most = 0.0
    edges = np.flatnonzero(np.diff(np.concatenate([[False], saturated, [False]]).astype(int)))
    for begin, end in edges.reshape(-1, 2).tolist():
        part = error[begin : end + 1]
        most = max(most, float((part - np.minimum.accumulate(part)).max()))
    if saturated[-1] and 2 * (end - begin) >= len(error) and part[-1] >= 0.9 * part[0]:
        most = max(most, float(part[-1]))
    return most


def sag_warning(
    controller: Controller,
    reference: Reference | None,
    times: FloatArray,
    tips: Callable[[], FloatArray],
) -> str:
    """Describe the sag that a law keeps at rest along the joint angles of a rigid arm, or nothing.

    Only of laws that plan the bending along a motion: of others, gains on joint angles, nobody
    expects the tip at its goal. ``tips`` returns (samples, 2) of the run, m.
    """
    laws = [law for law in around(controller) if getattr(law, "plans_bending", False)]
    if not laws or not isinstance(reference, Motion) or not any(laws[0].arm.spec.gravity):
        return ""
    late = (times > reference.end_time) & (2.0 * times >= reference.end_time + times[-1])
    if late.sum() < _RESTING:
        return ""
    arm: Arm = laws[0].arm
    goal, tip = tip_reference(arm, reference, times[-1:])[0], tips()[late]
    missed = tip.mean(axis=0) - goal
    error, moving = np.hypot(*missed), np.hypot(*np.ptp(tip, axis=0))
    if error < _SAGGING * arm.reach or moving > 0.1 * error:
        return ""
    try:
        with without_warnings():  # the run has its own
            rest = equilibrium(arm, np.asarray(reference.joint_angle(float(times[-1]))))
    except FlexarmError:
        return ""
    sag = arm.tip(rest.q)[:2] - goal
    if np.hypot(*(missed - sag)) > 0.5 * np.hypot(*sag):
        return ""
    name, apart = type(laws[0]).__name__, length_text(float(error))
    return (
        f"the tip rests {apart} from the end of its motion: along the joint angles of a rigid arm, "
        f"{name} keeps the sag of the links under gravity. Follow fa.quasi_static_reference(arm, "
        "motion, order=0) where it exists, or integrate the error of the tip; see "
        "docs/how-to/control-linear.md."
    )


def instrument_numbers(readings: Sequence[Readings]) -> dict[str, FloatArray]:
    """Return the share and the longest time at the limit of the instruments that have one."""
    pairs = [item.saturation() for item in readings if item.limited]
    if not pairs:
        return {}
    share, longest = (np.stack(values, axis=-1) for values in zip(*pairs, strict=True))
    return {"reading_saturation": share, "longest_reading_saturation": longest}


def instrument_warning(readings: Sequence[Readings], numbers: Mapping[str, FloatArray]) -> str:
    """Describe the instrument that is at its limit the longest; empty if none is for long."""
    limited = [item for item in readings if item.limited]
    if not limited:
        return ""
    share = np.array([item.signal != "contact_gap" for item in limited])
    share = share * numbers["reading_saturation"]
    worst = int(np.argmax(share))
    if not share[worst] > _BLIND:
        return ""
    longest = float(numbers["longest_reading_saturation"][worst])
    return (
        f"the instrument {limited[worst].labels[0]!r} is at its limit for {share[worst]:.0%} of "
        f"the run, up to {longest:.3g} s at a time, and does not measure the motion there: raise "
        "its limit or move more slowly."
    )


def _stops(run: Run) -> tuple[dict[str, FloatArray], str]:
    """Return the numbers of joint stops, NaN for joints without, and a warning or empty text."""
    if all(joint.limits is None for joint in _joints(run.arm)):
        return {}, ""
    beyond = []
    for _, part in run.parts():
        rows = part.arm.assembly.joint_body
        angle = part.samples[: part.progress.sample, 0, rows, 0]
        pairs = [
            (one.limits.lower, one.limits.upper) if one.limits else (np.nan, np.nan)
            for one in _joints(part.arm)
        ]
        lower, upper = np.array(pairs).T
        beyond.append(np.stack([lower - angle, angle - upper], axis=1))
    depth = np.concatenate(beyond)  # (samples, sides, joints)
    hits = (np.diff(depth > 0.0, axis=0, prepend=False) & (depth > 0.0)).sum(axis=(0, 1))
    deepest = np.maximum(depth.max(axis=(0, 1)), 0.0)
    limited = np.isfinite(deepest)
    if run.integrator.adaptive and limited.sum() == 1:
        hits[limited] = (run.progress.impacts + 1) // 2  # each impact begins and ends
    count = np.where(limited, hits, np.nan)
    numbers = {"stop_depth": deepest, "stop_hits": count}
    sizes = coordinate_sizes(run.arm)[run.arm.joint_index].tolist()
    listed = run.arm.joint_numbers, _joints(run.arm), deepest, sizes
    for number, joint, beyond_stop, size in zip(*listed, strict=True):
        if joint.limits is None:
            continue
        width, turns = joint.limits.upper - joint.limits.lower, joint.kind == "revolute"
        if beyond_stop > min(max(_OF_RANGE * width, _TURNED[0] * size), _TURNED[1] * size):
            verb, unit, cause = ("turns", "rad", "torque") if turns else ("slides", "m", "force")
            text = (
                f"joint {number} {verb} {beyond_stop:.3g} {unit} beyond its stop, "
                f"{beyond_stop / width:.0%} of its range: raise the stiffness of the stop, or "
                f"check the {cause} and the limits."
            )
            return numbers, text
    return numbers, ""


def _joints(arm: Arm) -> list[Any]:
    """Return the joints of an arm that are not fixed."""
    return [joint for joint in arm.spec.joints if not joint.fixed]


def deep_contact(arm: Arm, placed: Contacts, states: FloatArray) -> str:
    """Describe the deepest of contacts that are deeper than plausible; empty if none is."""
    if not placed.body.size or not len(states):
        return ""
    reach = arm.reach
    bend = np.maximum(placed.law[:, SURFACE + CURVATURE], _OF_RADIUS / (_OF_REACH * reach))
    allowed = _OF_RADIUS / bend  # a fraction of the reach, or less where a post is thinner
    near = -contact_values(arm, placed, states[::_STRIDE])[..., GAP]
    if not np.any(near > 0.5 * allowed):
        return ""
    depth = -contact_values(arm, placed, states)[..., GAP].min(axis=0)
    worst = int(np.argmax(depth / allowed))
    if not depth[worst] > allowed[worst]:
        return ""
    return (
        f"contact {worst + 1} is up to {depth[worst]:.3g} m deep in its surface, "
        f"{depth[worst] / reach:.0%} of the reach of the arm: raise its stiffness, or check the "
        "surface, its normal and the load."
    )


def limits_of_run(
    run: Run, loop: ClosedLoop | None, channels: Mapping[str, FloatArray]
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return the numbers ``LIMITS`` of a run that it has, and its warnings."""
    numbers, text = _stops(run)
    parts = [part for _, part in run.parts()]
    texts = [text]
    for part in parts:
        states = part.samples[: part.progress.sample]
        texts.append(deep_contact(part.arm, part.loads.placed.contacts, states))
    if "contact_gap" in channels and len(channels["contact_gap"]):
        numbers["contact_depth"] = np.maximum(-channels["contact_gap"].min(axis=0), 0.0)
    if loop is None:
        return numbers, list(filter(None, texts))
    readings = loop.instruments
    numbers |= instrument_numbers(readings)
    texts.append(instrument_warning(readings, numbers))
    if loop.acting.limited and loop.times:
        since, saturated = loop.acting.saturated()
        numbers |= motor_numbers(since, saturated, run.progress.time)
        times = run.sample_times[: run.progress.sample]
        angle = run.samples[: len(times), 0, run.arm.assembly.joint_body, 0]
        limits = since, saturated
        law = loop.controller, loop.reference
        texts.append(motor_warning(run.arm, *law, times, angle, limits, numbers))
    return numbers, list(filter(None, texts))


def notices_of(run: Run, limits: Sequence[str], failure: str) -> Notices:
    """Return the warnings of a run, with those of its ``limits``.

    Loads and limits of a run with a ``failure`` are those of a motion that no arm makes.
    """
    parts = [part for _, part in run.parts()]
    bent = (theory_error(part.arm, part.samples) for part in parts)
    notices: Notices = [(next(filter(None, bent), ""), LargeDeflectionWarning)]
    pulled = (
        axial_loads(part.arm, part.sample_times[:count], part.samples[None, :count], part.loads)[0]
        for part in (() if failure else parts)
        for count in [part.progress.sample]
    )
    notices += [(next(filter(None, pulled), ""), LargeDeflectionWarning)]
    notices += [] if failure else [(text, LimitWarning) for text in limits]
    notices.append((run.doubt, AccuracyWarning))
    return [notice for notice in notices if notice[0]]


def add_limits(
    dataset: xr.Dataset,
    arm: Arm,
    numbers: Mapping[str, FloatArray],
    readings: Sequence[Readings],
) -> xr.Dataset:
    """Add the numbers of ``LIMITS`` to the result of a run with some instruments."""
    if not numbers:
        return dataset
    dataset = dataset.assign(limit_variables(arm, numbers))
    names = [item.labels[0] for item in readings if item.limited]
    if names:
        label = {"long_name": "instrument with a limit"}
        dataset = dataset.assign_coords(instrument=("instrument", names, label))
    return dataset


def limit_variables(
    arm: Arm, numbers: Mapping[str, FloatArray], before: Sequence[str] = ()
) -> dict[str, tuple[tuple[str, ...], FloatArray, dict[str, str]]]:
    """Return numbers of ``LIMITS`` as variables of a dataset; ``before``: dimensions in front."""
    variables = {}
    for name, values in numbers.items():
        labels = channel_labels(arm, LIMITS[name])
        variables[name] = (*before, *LIMITS[name].dims), values, labels
    return variables
