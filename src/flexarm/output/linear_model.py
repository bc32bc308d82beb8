"""Linear models to files: MATLAB's and JSON."""

from __future__ import annotations

import json
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.errors import InputError, Problem, shown
from flexarm.places import AnyPath, check_place, write_text, write_whole

if TYPE_CHECKING:
    # Not at run time: processes that only draw figures would load the kernels for nothing.
    from flexarm.linear import LinearModel

#: What a linear model's file may end in.
MODEL_SUFFIXES = (".mat", ".json")


def save_linear(model: LinearModel, path: AnyPath) -> None:
    """Write a linear model to a ``.mat`` or ``.json`` file, whole or not at all.

    Both hold the same names: ``A``, ``B``, ``C``, ``D``, ``mass``, ``damping``, ``stiffness``, the
    operating point, and the names and units of states, inputs and outputs. In MATLAB
    ``load model.mat; sys = ss(A, B, C, D)``; the names are cell arrays.

    Missing folders are made, as by all that saves.

    Raises:
        InputError: no linear model, an unknown suffix, or a path that cannot be written.
    """
    from flexarm.linear import LinearModel

    if not isinstance(model, LinearModel):
        hint = "fa.linearize makes one."
        rule = "be a LinearModel"
        raise InputError(Problem("save_linear", "model", rule, shown(model), hint))
    place = check_place("save_linear", "path", path, MODEL_SUFFIXES)
    if place.suffix.lower() == ".json":
        write_text(json.dumps(_plain(model.arrays()), indent=1) + "\n", place)
    else:
        write_whole(place, [_mat(model)])


def _mat(model: LinearModel) -> bytes:
    from scipy.io import savemat

    cells = {
        name: np.array(value, dtype=object) if isinstance(value, list) else value
        for name, value in model.arrays().items()
    }
    content = BytesIO()
    savemat(content, cells, oned_as="column", do_compression=True)
    return content.getvalue()


def _plain(arrays: dict[str, Any]) -> dict[str, Any]:
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in arrays.items()
    }
