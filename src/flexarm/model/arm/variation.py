"""Variation of the parameters of an arm by factors, for example to test controllers."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from flexarm.base.errors import InputError, Problem, shown
from flexarm.model.arm.joints import Friction, Joint
from flexarm.model.arm.links import Link
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.quantities import plain


def varied_spec(
    spec: ArmSpec,
    *,
    payload_factor: float = 1.0,
    payload_mass: float | None = None,
    flexural_rigidity_factor: float | Sequence[float] = 1.0,
    mass_factor: float | Sequence[float] = 1.0,
    friction: Friction | Sequence[Friction | None] | None = None,
) -> ArmSpec:
    """Return a description with changed parameters; arguments as in ``flexarm.varied``.

    Raises:
        InputError: if a factor is negative or not a number, or a list has the wrong length.
    """
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
    if problems:
        raise InputError(*problems)
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
