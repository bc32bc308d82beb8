"""Identifications as one dataset, which ``write_result`` and ``read_result`` store."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.model import Motors
from flexarm.model.file_format.content import content_of
from flexarm.model.file_format.files import arm_spec_of_text, file_text

if TYPE_CHECKING:
    from flexarm.identification.result import Identification

#: Attribute of such a dataset, and the tables of a result.
KIND = "identification"
_TABLES = ("parameters", "initial", "fit", "validation")


def stored(found: Identification) -> xr.Dataset:
    """Return an identification as one dataset."""
    tables = {name: getattr(found, name) for name in _TABLES}
    tables |= {f"record_{k}": table for k, table in enumerate(found.histories.values())}
    # NetCDF has no names of nothing.
    kept = {
        name: table.drop_dims([dim for dim, size in table.sizes.items() if not size])
        for name, table in tables.items()
    }
    parts = [_prefixed(name, table) for name, table in kept.items() if table.data_vars]
    attributes: dict[str, Any] = {
        "undetermined": list(found.undetermined),
        "noise": dict(found.noise),
        "starts": list(found.starts),
        "converged": found.converged,
        "method": found.method,
        "torque_noise": None if found.torque_noise is None else found.torque_noise.tolist(),
        "histories": list(found.histories),
        "arms": {name: file_text(arm.spec) for name, arm in found.arms.items()},
        "motors": None if found.motors is None else content_of(found.motors),
    }
    return xr.merge(parts).assign_attrs(
        flexarm_version=found.flexarm_version,
        arm=file_text(found.arm.spec),
        **{KIND: json.dumps(attributes)},
    )


def restored(dataset: xr.Dataset) -> dict[str, Any]:
    """Return the fields of an identification from its dataset.

    Raises:
        InputError: if the dataset does not contain an identification.
    """
    if KIND not in dataset.attrs:
        raise InputError(Problem("dataset", "does not contain an identification"))
    try:
        given = json.loads(dataset.attrs[KIND])
        names = given.pop("histories")
        fields: dict[str, Any] = {
            "parameters": _table(dataset, "parameters"),
            "fit": _table(dataset, "fit"),
        }
        nothing = slice(0, 0)
        fields["initial"] = _table(dataset, "initial") or fields["parameters"].isel(
            parameter=nothing, other=nothing
        )
        fields["validation"] = _table(dataset, "validation") or fields["fit"].isel(record=nothing)
        fields["histories"] = {name: _history(dataset, k) for k, name in enumerate(names)}
        noise, motors = given["torque_noise"], given["motors"]
        return {
            **fields,
            **given,
            "undetermined": tuple(given["undetermined"]),
            "starts": tuple(given["starts"]),
            "torque_noise": None if noise is None else np.array(noise),
            "motors": None if motors is None else Motors(**motors),
            "flexarm_version": dataset.attrs["flexarm_version"],
            "arm": _arm(dataset.attrs["arm"]),
            "arms": {name: _arm(text) for name, text in given["arms"].items()},
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        rule = f"contains a damaged identification: {type(error).__name__}"
        raise InputError(Problem("dataset", rule)) from None


def is_identification(value: object) -> bool:
    """Return whether a value is the dataset of an identification."""
    return isinstance(value, xr.Dataset) and KIND in value.attrs


def _history(dataset: xr.Dataset, record: int) -> xr.Dataset:
    """Return the history of a record, with ``driven`` also if it has no inputs."""
    table = _table(dataset, f"record_{record}")
    if "driven" in table:
        return table
    nothing = np.zeros((table.sizes["time"], 0))
    return table.assign(driven=(("time", "input"), nothing)).assign_coords(input=[])


def _arm(text: str) -> Arm:
    return Arm(arm_spec_of_text(text, "result"))


def _prefixed(name: str, table: xr.Dataset) -> xr.Dataset:
    """Return a table with the prefix of its name before all variables and dimensions."""
    return table.rename({str(key): f"{name}.{key}" for key in {*table.variables, *table.dims}})


def _table(dataset: xr.Dataset, name: str) -> xr.Dataset:
    """Return the table whose variables have the prefix of a name."""
    own = [str(key) for key in dataset.variables if str(key).startswith(f"{name}.")]
    table = dataset[own].drop_attrs()
    for key in own:
        table[key].attrs = dict(dataset[key].attrs)
    names: Mapping[str, str] = {
        str(key): str(key).removeprefix(f"{name}.") for key in {*table.variables, *table.dims}
    }
    return table.rename(names)
