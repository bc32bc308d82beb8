"""Valid arguments for studies with samples, in addition to `base_calls`."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import flexarm as fa
from fuzz.base_calls import folder

_SAMPLES = "vary: {payload.mass: {kind: uniform, low: 0, high: 1}}\nsamples: {count: 2}\n"


@cache
def samples() -> Path:
    """Return the file of a study with samples, whose store is beside it."""
    place = folder() / "samples.yaml"
    place.write_text((folder() / "study.yaml").read_text() + _SAMPLES)
    fa.Study(place).run(place.with_suffix(".zarr"), workers=1, chunk=2)
    return place


@cache
def study_table() -> Any:
    return fa.read_study(samples().with_suffix(".zarr"))


#: Functions and constructors.
STUDIES: dict[str, dict[str, Any]] = {
    "Study": {"study": samples},
    "read_study": {"store": lambda: samples().with_suffix(".zarr")},
    "sensitivity_indices": {"table": study_table, "resamples": 2},
    "study_statistics": {"table": study_table},
}
#: Methods of a study.
STUDY_METHODS: dict[str, Any] = {
    "Study": (
        lambda: fa.Study(samples()),
        {
            "nominal": {"workers": 1},
            "run": {"workers": 1, "chunk": 2},  # one task, which needs no other process
            "rare_failures": {"samples": 100, "limits": {"tip_error_peak": 1e-6}},
            "verify": {"store": lambda: samples().with_suffix(".zarr"), "count": 1},
        },
    ),
}
