"""Valid arguments of the Kalman filters and their methods."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import numpy as np

import flexarm as fa
from conformance.controller_examples import kalman_filter, two_links

KINDS = (fa.ExtendedKalmanFilter, fa.UnscentedKalmanFilter, fa.MovingHorizonEstimator)
_ARGUMENTS = {
    "arm": cache(two_links),
    "instruments": lambda: kalman_filter().instruments,
    "sample_time": 0.004,
}
FILTERS: dict[str, dict[str, Any]] = {kind.__name__: _ARGUMENTS for kind in KINDS}


def _made(kind: Any) -> Any:
    return kind(two_links(), kalman_filter().instruments, sample_time=0.004)


def _measurement() -> fa.Measurement:
    return fa.Measurement(joint_angle=np.array([0.1, 0.3]), strain=np.zeros(1))


_METHODS: dict[str, dict[str, Any]] = {
    "begin": {
        "q": [0.1, 0.0, 0.0, 0.3, 0.0, 0.0],
        "qd": [0.0] * 6,
        "payload_mass": 0.0,
        "covariance": np.eye(13).tolist(),
    },
    "correct": {"measurement": _measurement},
    "predict": {"torque": [0.0, 0.0]},
    "report": {},
    "reset": {},
    "run": {
        "torque": [[0.0, 0.0]] * 2,
        "readings": lambda: {"joint_angle": [[0.1, 0.3]] * 2, "strain": [[0.0]] * 2},
    },
}
FILTER_METHODS: dict[str, tuple[Any, dict[str, dict[str, Any]]]] = {
    kind.__name__: (partial(_made, kind), _METHODS) for kind in KINDS
}


def _estimates() -> Any:
    """Return the estimates of two samples."""
    readings = {"joint_angle": [[0.1, 0.3]] * 2, "strain": [[0.0]] * 2}
    return _made(fa.ExtendedKalmanFilter).run([[0.0, 0.0]] * 2, readings)


FILTER_METHODS["run()"] = (
    _estimates,
    {
        "error_band": {"probability": 0.9},
        "innovation_band": {"probability": 0.9},
        "squared_errors": {
            "q": [[0.1, 0.0, 0.0, 0.3, 0.0, 0.0]] * 2,
            "qd": [[0.0] * 6] * 2,
            "payload_mass": 0.1,
        },
    },
)
