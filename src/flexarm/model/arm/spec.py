"""Description of an arm: joints, links, payload, gravity and theory, and variations by factors."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from flexarm.base.errors import InputError, Problem, raise_any, shown
from flexarm.model.arm.joints import Friction, Joint
from flexarm.model.arm.links import Link
from flexarm.model.arm.mechanism import (
    Base,
    Closure,
    Payload,
    at_tip,
    carriers,
    closure_faults,
    inertia_faults,
    tree_faults,
)
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Listed, Pair, length_of, plain
from flexarm.model.wording import Fault

MOST_LINKS = 256


class ArmSpec(Record):
    """A planar arm; joint i is at the root of link i, in a serial arm at the tip of link i-1.

    Links that name their `parent` form a tree. With sliding joints, a base that moves and closures
    the arm is a mechanism.
    """

    links: Listed[Link] = Field(json_schema_extra={"minItems": 1, "maxItems": MOST_LINKS})
    """Links from the base to the tip."""
    joints: Listed[Joint] = Field(default=(), validate_default=True)
    """One joint for each link, at its root; ideal joints by default."""
    payload: Payload = Payload()
    """Rigid body at the tip of the last link."""
    gravity: Pair = (0.0, 0.0)
    """Acceleration of gravity [x, y] in the world frame (m/s^2)."""
    base: Base = Base()
    """Body that carries the first joint; by default the ground."""
    closures: Listed[Closure] = ()
    """Connections that close loops; none by default."""
    theory: Literal["linear", "second_order"] = "linear"
    """Beam theory: linear, or second_order with shortening due to bending."""

    @field_validator("payload", mode="before")
    @classmethod
    def _no_payload(cls, value: Any) -> Any:
        """Convert None to an arm without a payload."""
        return Payload() if value is None else value

    _called: ClassVar[str] = "Arm"
    _hints: ClassVar[dict[str, str]] = {
        "gravity": "Gravity that pulls down is [0, -9.81].",
    }

    @field_validator("joints", mode="before")
    @classmethod
    def _ideal_joints(cls, value: Any, info: ValidationInfo) -> Any:
        """Return ideal joints if none are described."""
        if plain(value) in (None, [], ()):
            return (Joint(),) * len(info.data.get("links", ()))
        return value

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        # Compare the lengths of the raw values, because single links and joints may be invalid.
        links, joints = length_of(given.raw("links")), length_of(given.raw("joints"))
        if links is not None and not 1 <= links <= MOST_LINKS:
            yield Fault(("links",), f"have 1 to {MOST_LINKS} entries", str(links))
        if links and joints and joints != links:
            yield Fault(("joints",), f"have length {links}, one joint for each link", str(joints))
        if not links or not given.has("links"):
            return
        faults = list(tree_faults(given.links))
        yield from faults
        if given.has("base", "closures"):
            yield from closure_faults(given.links, given.base, given.closures)
        if links == joints and not faults and given.has("joints", "payload", "base"):
            yield from inertia_faults(given.links, given.joints, given.payload, given.base)

    @property
    def parents(self) -> tuple[int, ...]:
        """Index, from 0, of the link that carries the joint of each link; -1 for the base."""
        return carriers(self.links)

    @property
    def features(self) -> tuple[str, ...]:
        """Features that a serial arm on a fixed base does not have, in words; empty for those."""
        follows = all(
            parent == i - 1 and (i == 0 or at_tip(self.links[parent], link.parent_station))
            for i, (link, parent) in enumerate(zip(self.links, self.parents, strict=True))
        )
        placed = any(any(joint.offset) or joint.mounting_angle for joint in self.joints)
        features = {
            "branches": not follows,
            "sliding joints": any(joint.kind == "prismatic" for joint in self.joints),
            "joints with an offset or a mounting angle": placed,
            "a free base": bool(self.base.free),
            "closures": bool(self.closures),
        }
        return tuple(name for name, present in features.items() if present)

    @property
    def is_serial(self) -> bool:
        """Whether every link follows the one before, without any of the `features`."""
        return not self.features


#: Features with which the coordinates of the joints do not determine the rigid posture.
FREE_BASE, CLOSURES = ("a free base",), ("closures",)
UNDRIVEN = FREE_BASE + CLOSURES


def serial_only(spec: ArmSpec, what: str, unsupported: Collection[str] | None = None) -> None:
    """Raise for an arm with features that ``what`` does not support, by default all of others."""
    features = [name for name in spec.features if unsupported is None or name in unsupported]
    if features:
        listed = " and ".join(filter(None, (", ".join(features[:-1]), features[-1])))
        raise InputError(Problem(what, f"is not supported for arms with {listed}"))


def varied_spec(
    spec: ArmSpec,
    *,
    payload_factor: float = 1.0,
    payload_mass: float | None = None,
    flexural_rigidity_factor: float | Sequence[float] = 1.0,
    mass_factor: float | Sequence[float] = 1.0,
    friction: Friction | Sequence[Friction | None] | None = None,
) -> ArmSpec:
    """Return a description with changed parameters; arguments and errors as `flexarm.varied`."""
    problems: list[Problem] = []
    rigidity = _each(problems, "flexural_rigidity_factor", flexural_rigidity_factor, spec.links)
    mass = _each(problems, "mass_factor", mass_factor, spec.links)
    payload = _each(problems, "payload_factor", payload_factor, (None,), zero=True)[0]
    if payload_mass is not None:
        payload_mass = _each(problems, "payload_mass", payload_mass, (None,), zero=True)[0]
        if payload != 1.0:
            problems.append(Problem("payload_mass", "cannot be combined with payload_factor"))
    elif payload != 1.0 and spec.payload.mass == 0.0:
        rule = "is not supported for an arm without payload"
        problems.append(Problem("payload_factor", rule, hint="Give payload_mass in kg."))
    rubbing = _friction(problems, friction, spec.joints)
    raise_any(problems)
    carried = {"mass": spec.payload.mass * payload, "inertia": spec.payload.inertia * payload}
    if payload_mass is not None:
        carried = {"mass": payload_mass, "inertia": spec.payload.inertia}
    links = [_link(*item) for item in zip(spec.links, rigidity, mass, strict=True)]
    joints = [
        joint if rubs is None else joint.replace(friction=rubs)
        for joint, rubs in zip(spec.joints, rubbing, strict=True)
    ]
    return spec.replace(links=links, joints=joints, payload=spec.payload.replace(**carried))


def _each(
    problems: list[Problem], name: str, value: Any, of: Sequence[Any], zero: bool = False
) -> list[float]:
    """Return one factor for each of ``of``; all 1 if the value is invalid."""
    value = plain(value)
    values = list(value) if isinstance(value, list | tuple) else [value] * len(of)
    good = all(
        isinstance(v, (int, float))
        and not isinstance(v, bool)
        and (0.0 < v <= sys.float_info.max or (zero and v == 0.0))
        for v in values
    )
    if not good or len(values) != len(of):
        rule = f"be a number {'at least' if zero else 'greater than'} 0"
        rule += f", or one for each of the {len(of)} links" if len(of) > 1 else ""
        problems.append(Problem(name, rule, shown(value)))
        return [1.0] * len(of)
    return [float(v) for v in values]


def _friction(
    problems: list[Problem], friction: Any, joints: Sequence[Joint]
) -> list[Friction | None]:
    if friction is None:
        return [None] * len(joints)
    if isinstance(friction, Friction):
        return [None if joint.fixed else friction for joint in joints]
    listed: list[Any] = list(friction) if isinstance(friction, Sequence) else [0]
    if len(listed) != len(joints) or not all(isinstance(f, Friction | None) for f in listed):
        rule = "be a Friction, or a list with a Friction or None for each joint"
        problems.append(Problem("friction", rule, shown(friction)))
        return [None] * len(joints)
    return listed


def _link(link: Link, rigidity: float, mass: float) -> Link:
    """Return a link with scaled bending stiffness, and with scaled mass and rotary inertia."""
    if rigidity == 1.0 and mass == 1.0:
        return link
    if link.material is None and link.table is None:
        changed: dict[str, Any] = {}
        if link.flexural_rigidity is not None:
            changed["flexural_rigidity"] = link.flexural_rigidity * rigidity
        for name in ("mass_per_length", "rotary_inertia_per_length"):
            value = getattr(link, name)
            changed[name] = None if value is None else value * mass
        return link.replace(**changed)
    table = link.beam()
    columns: dict[str, Any] = {}
    if table.flexural_rigidity is not None:
        columns["flexural_rigidity"] = [rigidity * v for v in table.flexural_rigidity]
    columns["mass_per_length"] = [mass * v for v in table.mass_per_length]
    columns["rotary_inertia_per_length"] = [mass * v for v in table.rotary_inertia_per_length or ()]
    return link.replace(material=None, section=None, table=table.replace(**columns))
