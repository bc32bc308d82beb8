"""Description of an arm: links, joints, payload, gravity and theory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Literal

from pydantic import Field, ValidationInfo, field_validator

from flexarm.base.errors import shown
from flexarm.model.arm.joints import Joint, Payload
from flexarm.model.arm.links import Link
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Listed, Pair, length_of, plain
from flexarm.model.wording import Fault

MOST_LINKS = 256


class ArmSpec(Record):
    """A planar serial arm; joint i is between the tip of link i-1 and the root of link i."""

    links: Listed[Link] = Field(json_schema_extra={"minItems": 1, "maxItems": MOST_LINKS})
    """Links from the base to the tip."""
    joints: Listed[Joint] = Field(default=(), validate_default=True)
    """One joint for each link, at its root; ideal joints by default."""
    payload: Payload = Payload()
    """Rigid body at the tip of the last link."""
    gravity: Pair = (0.0, 0.0)
    """Acceleration of gravity [x, y] in the world frame (m/s^2)."""
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
        if links and links == joints and given.has("links", "joints", "payload"):
            yield from _inertia_faults(given.links, given.joints, given.payload)


def place_faults(
    arm: ArmSpec, link: int, furthest: float | None, name: str = "station"
) -> Iterator[Fault]:
    """Yield a fault if an arm has no such link, or a distance (m) from its root is beyond its tip.

    Args:
        name: name of the distance.
    """
    links = arm.links
    if not 1 <= link <= len(links):
        yield Fault(("link",), f"be the number of a link, 1 to {len(links)}", shown(link))
        return
    length = links[link - 1].length
    if furthest is not None and furthest > length * (1.0 + 1e-9):  # sums of lengths are rounded
        yield Fault((name,), f"be at most {length:.9g} (the length of the link)", shown(furthest))


def _inertia_faults(
    links: Sequence[Link], joints: Sequence[Joint], payload: Payload
) -> Iterator[Fault]:
    """Yield a fault for each joint whose torque acts on no inertia in any posture.

    The links between two joints that turn are fixed to each other and rotate together.
    """
    tables = [link.beam() for link in links]
    heavy = [any(table.mass_per_length) for table in tables]
    turned = [any(table.rotary_inertia_per_length or ()) for table in tables]
    turned = [own or joint.hub_inertia > 0 for own, joint in zip(turned, joints, strict=True)]
    carried = [joint.mass > 0 for joint in joints[1:]] + [payload.mass > 0]
    attached = [joint.housing_inertia > 0 for joint in joints[1:]] + [payload.inertia > 0]
    turning = [i for i, joint in enumerate(joints) if not joint.fixed]
    for i, end in zip(turning, [*turning[1:], len(joints)], strict=False):
        geared = joints[i].rotor_inertia > 0 and not joints[i].elastic
        # Bodies that rotate about a joint further out resist with their mass only.
        if geared or any(turned[i:end] + attached[i:end] + heavy[i:] + carried[i:]):
            continue
        if end < len(joints):
            hint = (
                "Give mass to the link or to bodies that it carries, or hub_inertia to its joint."
            )
            yield Fault(("links", i), "has no inertia and carries no mass", hint=hint)
        else:
            hint = "Give mass to the last link, hub_inertia to its joint, or a payload to the arm."
            yield Fault(
                ("payload", "mass"), "be greater than 0 at the tip of a massless link", "0", hint
            )
