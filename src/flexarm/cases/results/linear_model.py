"""Files of linear models, for MATLAB and as JSON."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.base.writing.mat_file import mat_bytes
from flexarm.base.writing.places import AnyPath, check_place, write_text, write_whole

if TYPE_CHECKING:
    # Import for type checks only, because processes that only draw figures do not need the kernels.
    from flexarm.linear import LinearModel

#: File suffixes of linear models.
MODEL_SUFFIXES = (".mat", ".json")


@public_call
def save_linear(model: LinearModel, path: AnyPath) -> None:
    """Write a linear model to a ``.mat`` or ``.json`` file, completely or not at all.

    Both contain the same names: ``A``, ``B``, ``C``, ``D``, ``mass``, ``damping``, ``stiffness``,
    the operating point, and the names and units of states, inputs and outputs. In MATLAB
    ``load model.mat; sys = ss(A, B, C, D)``; the names are cell arrays.

    Missing folders are created.

    Raises:
        InputError: if ``model`` is not a linear model, the suffix is unknown, or the path cannot
            be written.
    """
    from flexarm.linear import LinearModel

    if not isinstance(model, LinearModel):
        hint = "fa.linearize returns one."
        raise InputError(Problem("model", "be a LinearModel", shown(model), hint))
    place = check_place("path", path, MODEL_SUFFIXES)
    if place.suffix.lower() == ".json":
        write_text(json.dumps(_plain(model.arrays()), indent=1) + "\n", place)
    else:
        write_whole(place, [mat_bytes(model.arrays())])


def _plain(arrays: dict[str, Any]) -> dict[str, Any]:
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in arrays.items()
    }
