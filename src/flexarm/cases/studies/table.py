"""Dataset of a study: its varied numbers, metrics, failures and warnings over the samples."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexarm.cases.studies.execution import INFEASIBLE, RECORDED, Outcomes

if TYPE_CHECKING:
    import xarray as xr

#: Dimensions of a run in a study.
DIMS = ("sample", "controller", "plant", "reference")


def table_of(
    outcomes: Outcomes,
    numbers: NDArray[np.int64],
    names: Mapping[str, Sequence[str]],
    paths: Sequence[str],
    attributes: Mapping[str, Any],
) -> xr.Dataset:
    """Return the labelled dataset of outcomes.

    Args:
        numbers: (samples,) of the samples.
        names: of controllers, plants and references.
        paths: of the varied numbers.
    """
    import xarray as xr

    table = xr.Dataset(attrs=dict(attributes))
    label = {"long_name": "sample, counted from 0"}
    table = table.assign_coords({"sample": ("sample", numbers, label)})
    table = table.assign_coords({dim: list(own) for dim, own in names.items()})
    for j, path in enumerate(paths):
        label = {"long_name": f"{path} of the sample"}
        table = table.assign_coords({path: ("sample", outcomes.parameters[:, j], label)})
    for j, metric in enumerate(RECORDED):
        labels = {"units": metric.unit, "long_name": metric.meaning}
        table[metric.name] = (DIMS, outcomes.metrics[..., j], labels)
    texts = outcomes.failure.astype(str)
    absent = np.char.startswith(texts, INFEASIBLE)
    reasons = [text.removeprefix(INFEASIBLE) for text in np.where(absent, texts, "").flat]
    table["failure"] = (DIMS, np.where(absent, "", texts), {"long_name": "why a run failed"})
    label = {"long_name": "why the numbers of a run are not possible"}
    table["infeasible"] = (DIMS, np.array(reasons, dtype=str).reshape(texts.shape), label)
    table["warning"] = (DIMS, outcomes.warning.astype(str), {"long_name": "warnings of a run"})
    return table
