"""The two-link arm of Table I, which several cases are about."""

from __future__ import annotations

from typing import Any

import flexarm as fa

LENGTHS = (1.4142, 1.0)  # m
ROD: dict[str, Any] = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}


def two_link_arm(
    elements: int | tuple[int, int],
    *,
    theory: str = "linear",
    gravity: tuple[float, float] = (0.0, 0.0),
    **link: Any,
) -> fa.Arm:
    """Make the arm with a number of elements on each link, and further fields on both links."""
    counts = (elements, elements) if isinstance(elements, int) else elements
    links = [
        fa.Link(length=length, elements=count, **ROD, **link)
        for length, count in zip(LENGTHS, counts, strict=True)
    ]
    return fa.Arm(links=links, theory=theory, gravity=gravity)
