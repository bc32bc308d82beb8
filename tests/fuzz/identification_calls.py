"""Valid arguments of the public callables of identification."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import flexarm as fa
from conformance.controller_examples import two_links

FREE = ["links[0].flexural_rigidity"]


@cache
def turned() -> Any:
    """Return a result of a few samples."""
    return fa.simulate(two_links(), 0.02, torque=lambda t: [0.3, 0.1], rate=500.0)


def measured() -> fa.MeasuredRecord:
    return fa.MeasuredRecord(turned(), outputs=["joint_angle"])


@cache
def identified() -> fa.Identification:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return fa.identify(two_links(), measured(), FREE, iterations=1, progress=False)


IDENTIFICATION: dict[str, dict[str, Any]] = {
    "identify": {"arm": two_links, "records": measured, "free": FREE, "iterations": 1},
    "MeasuredRecord": {"data": turned, "outputs": ["joint_angle"]},
}
#: Methods of a result.
RESULT: dict[str, Any] = {
    "Identification": (
        identified,
        {
            "rows": {},
            "write": {"path": "identified.yaml"},
        },
    ),
}
