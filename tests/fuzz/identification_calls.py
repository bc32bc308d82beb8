"""Valid arguments of the public callables of identification."""

from __future__ import annotations

import warnings
from functools import cache
from typing import Any

import flexarm as fa
from arms import chain
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


@cache
def one_link() -> fa.Arm:
    """Return an arm with one joint and a gauge."""
    link = {"flexural_rigidity": 8.0, "mass_per_length": 0.4, "elements": 1}
    return chain([0.8], [0.02], gauge=(0.05, 0.002), **link)


def shaker() -> fa.Multisine:
    return fa.multisine(0.5, (2.0, 40.0), 0.1, rise=0.1)


@cache
def shaken() -> fa.MeasuredRecord:
    """Return a planned record of two periods."""
    result = fa.simulate(one_link(), 1.0, torque=shaker().samples(200.0, 1.0), rate=200.0)
    noise = {"joint_angle": 1e-4, "strain": 1e-6}
    return fa.MeasuredRecord(result, outputs=["joint_angle", "strain"], noise=noise)


@cache
def response() -> fa.FrequencyResponse:
    return fa.frequency_response(shaken(), period=0.5)


IDENTIFICATION: dict[str, dict[str, Any]] = {
    "identify": {"arm": two_links, "records": measured, "free": FREE, "iterations": 1},
    "commission": {"arm": one_link, "records": shaken, "rtol": 1e-3, "progress": False},
    "identifiability": {"arm": one_link, "records": shaken, "free": FREE},
    "frequency_response": {"records": shaken, "period": 0.5},
    "measured_modes": {"records": shaken, "count": 1},
    "multisine": {"period": 0.5, "band": (2.0, 40.0), "peak": 0.1},
    "Multisine": {"period": 0.5, "harmonics": [1, 2], "coefficients": [[1.0], [0.5]]},
    "optimal_excitation": {
        "arm": one_link,
        "free": FREE,
        "limits": lambda: fa.MotionLimits(torque=0.1),
        "noise": {"strain": 1e-6},
        "period": 0.2,
        "band": (5.0, 20.0),
        "lines": 2,
        "duration": 0.2,
        "iterations": 1,
    },
    "MeasuredRecord": {"data": turned, "outputs": ["joint_angle"]},
}
#: Methods of a result.
RESULT: dict[str, Any] = {
    "FrequencyResponse": (response, {"modes": {"count": 1}}),
    "Identifiability": (
        lambda: fa.identifiability(one_link(), shaken(), FREE),
        {"rows": {}},
    ),
    "MeasuredModes": (
        lambda: response().modes(1),
        {"compare": {"modes": lambda: fa.modes(one_link(), joints="free")}},
    ),
    "Multisine": (
        shaker,
        {
            "orthogonal": {},
            "samples": {"rate": 200.0, "duration": 0.5},
            "scaled": {"factor": 2.0},
        },
    ),
    "Identification": (
        identified,
        {
            "rows": {},
            "write": {"path": "identified.yaml"},
            "to_dataset": {},
            "from_dataset": {"dataset": lambda: identified().to_dataset()},
        },
    ),
}
