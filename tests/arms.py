"""Arms that many tests use: chains of links by a few numbers, and arms with names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import flexarm as fa
from flexarm.model import ArmSpec

#: Properties of both rods of Table I of the paper.
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
#: Numbers of `changing_link`, and its inertia about the joint.
LENGTH, MASS = 2.0, 0.2
INERTIA = 0.3 * LENGTH**3 / 3.0 + MASS * LENGTH**2


def chain(
    lengths: Sequence[float],
    joints: Sequence[Any] = (),
    *,
    damping: Any = None,
    gauge: tuple[float, float] | None = None,
    gauged: int | None = None,
    payload: Any = None,
    **fields: Any,
) -> fa.Arm:
    """Return an arm with links of these lengths, m.

    joints: hub inertias (kg m^2), fields of joints, or joints. damping: modal ratio, or damping, of
    all links. gauge: station and distance (m), on all links or the first ``gauged`` ones. payload:
    mass (kg) or payload. Other fields of the arm, or of its links: a list has one value for each
    link (but ``gauges``), all else is for every link.
    """
    if damping is not None:
        modal = isinstance(damping, float)
        fields["damping"] = fa.ModalDamping(ratio=damping) if modal else damping
    of_arm = {name: fields.pop(name) for name in {*fields} & {*ArmSpec.model_fields}}
    if joints:
        of_arm["joints"] = [_joint(joint) for joint in joints]
    if payload is not None:
        of_arm["payload"] = payload if not isinstance(payload, float) else fa.Payload(mass=payload)
    links = []
    for k, length in enumerate(lengths):
        own = {
            name: value[k] if isinstance(value, list) and name != "gauges" else value
            for name, value in fields.items()
        }
        if gauge is not None and (gauged is None or k < gauged):
            own["gauges"] = [fa.Gauge(station=gauge[0], distance=gauge[1])]
        links.append(fa.Link(length=length, **own))
    return fa.Arm(links=links, **of_arm)


def _joint(joint: Any) -> fa.Joint:
    if isinstance(joint, float):
        return fa.Joint(hub_inertia=joint)
    return fa.Joint(**joint) if isinstance(joint, dict) else joint


def unit_link(joint: Any = None, **fields: Any) -> fa.Arm:
    """Return one rigid link with an inertia of 1 kg m^2 about its joint: acceleration is torque."""
    joints = () if joint is None else (joint,)
    return chain([1.0], joints, mass_per_length=3.0, flexible=False, **fields)


def soft_rod(**joint: Any) -> fa.Arm:
    """Return a soft light rod with one mode on a heavy hub."""
    rod = {"flexural_rigidity": 100.0, "mass_per_length": 0.05, "elements": 1, "modes": 1}
    return chain([1.0], [{"hub_inertia": 0.1, **joint}], **rod)


def two_rods(gauged: int = 0) -> fa.Arm:
    """Return two rods with hubs, the first ``gauged`` ones with a gauge."""
    rod = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
    return chain((0.8, 0.6), [0.05, 0.03], gauge=(0.1, 0.005), gauged=gauged, **rod)


def observed_link(payload: float = 0.2, friction: Any = None, **fields: Any) -> fa.Arm:
    """Return a link with a gauge, one mode and a payload, for tests of observers."""
    joint = {"hub_inertia": 0.05, "damping": 0.1, "friction": friction}
    rod = {"flexural_rigidity": 40.0, "mass_per_length": 0.4, "elements": 4, "modes": 1}
    return chain([1.0], [joint], gauge=(0.03, 0.005), payload=payload, **rod, **fields)


def table_one_arm(
    rigidity: float = 105.0, elements: int | Sequence[int] = (2, 1), **fields: Any
) -> fa.Arm:
    """Return the arm of Table I with a coarse mesh; ``fields`` are those of `chain`."""
    fields["elements"] = elements if isinstance(elements, int) else list(elements)
    rod = {"flexural_rigidity": rigidity, "mass_per_length": 0.61732}
    return chain((1.4142, 1.0), **rod, **fields)


def laboratory_arm(
    rigidity: float = 1.0, payload: float = 0.0, rod: dict[str, Any] | None = None, **fields: Any
) -> fa.Arm:
    """Return the arm of the how-to pages: the rods of Table I, with hubs and an elbow motor.

    rigidity: factor on that of Table I. payload: mass, kg. rod: more fields of both links.
    """
    joints = [0.1, {"mass": 0.5, "hub_inertia": 0.02, "housing_inertia": 0.02}]
    fields = {"joints": joints, "payload": payload, **(rod or {}), **fields}
    return table_one_arm(105.0 * rigidity, **fields)


def changing_link(**joint: Any) -> fa.Arm:
    """Return a rigid link with a payload, for tests of changes during a run."""
    return chain([LENGTH], [joint], payload=MASS, flexible=False, mass_per_length=0.3)


def changing_links(offset: tuple[float, float] = (0.0, 0.0), **fields: Any) -> fa.Arm:
    """Return two links with gauges and a payload, for tests of changes during a run."""
    payload = fa.Payload(mass=0.1, offset=offset)
    rod = {"elements": [2, 1], "flexural_rigidity": 105.0, "mass_per_length": 0.6}
    joints = [0.1, {"mass": 0.5, "hub_inertia": 0.1}]
    return chain((1.4, 1.0), joints, payload=payload, gauge=(0.05, 0.005), **rod, **fields)


def moving(arm: fa.Arm, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """Return coordinates and rates of an arm of two links in motion, with bent links."""
    rng = np.random.default_rng(seed)
    q, qd = 0.02 * rng.normal(size=arm.dof), 0.1 * rng.normal(size=arm.dof)
    q[arm.joint_index], qd[arm.joint_index] = [0.4, 0.9], [0.8, -0.5]
    return q, qd


def with_payload(arm: fa.Arm, **numbers: float) -> Any:
    """Return the specification of the arm with other numbers of its payload."""
    return arm.spec.replace(payload=arm.spec.payload.replace(**numbers))
