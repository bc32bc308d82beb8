"""The two-link arm of Table I of the paper, and the laboratory arm with its rods."""

from __future__ import annotations

from typing import Any

import flexarm as fa

#: Properties of both rods.
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}


def _links(rod: dict[str, Any]) -> list[fa.Link]:
    return [fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)]


def table_one_arm(rigidity: float = 105.0, **fields: Any) -> fa.Arm:
    """Return the arm of Table I with a coarse mesh; ``fields`` are those of the arm."""
    return fa.Arm(links=_links({**ROD, "flexural_rigidity": rigidity}), **fields)


def laboratory_arm(
    rigidity: float = 1.0, payload: float = 0.0, rod: dict[str, Any] | None = None, **fields: Any
) -> fa.Arm:
    """Return the arm of the how-to pages: the rods of Table I, with hubs and an elbow motor.

    rigidity: factor on that of Table I. payload: mass, kg. rod: more fields of both links.
    """
    section = {**ROD, "flexural_rigidity": 105.0 * rigidity, **(rod or {})}
    joints = [
        fa.Joint(hub_inertia=0.1),
        fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
    ]
    return fa.Arm(links=_links(section), joints=joints, payload=fa.Payload(mass=payload), **fields)
