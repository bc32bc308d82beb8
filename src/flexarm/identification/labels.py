"""Names of single channels, as in the header of a CSV file: ``joint_angle_1``, ``tip_x``."""

from __future__ import annotations

import re
from collections.abc import Collection
from typing import NamedTuple

import numpy as np
import xarray as xr

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, nearest, shown
from flexarm.model.hardware import CHANNEL_SIGNALS
from flexarm.model.identification.records import UNITS
from flexarm.simulation.run.channels import CHANNELS, Channel

#: Inputs of the motors, which simulated results do not contain.
CURRENT = Channel("current", ("joint",), "A", "current of the joint motors")
VOLTAGE = Channel("voltage", ("joint",), "V", "voltage of the joint motors")
#: Channels of records by name: those that instruments measure, without contacts, and these inputs.
MEASURED: dict[str, Channel] = {
    name: CHANNELS[name] for name in CHANNEL_SIGNALS if "contact" not in CHANNELS[name].dims
} | {"current": CURRENT, "voltage": VOLTAGE}
_UNIT = re.compile(r"^(.*?)(\s*)[\[(]([^\])]*)[\])]$")


class Label(NamedTuple):
    """One number of a channel at a time."""

    channel: str  # name of the channel
    #: Number of the joint, link or gauge, counted from 1, or the axis "x" or "y"; empty for a
    #: channel of one number
    part: int | str

    @property
    def text(self) -> str:
        """Name in tables: ``joint_angle_1``."""
        return f"{self.channel}_{self.part}" if self.part != "" else self.channel


def label_of(text: str) -> Label | None:
    """Return the label of a name, or None if no channel has it."""
    if text in MEASURED:
        return None if MEASURED[text].dims else Label(text, "")
    stem, _, part = text.rpartition("_")
    channel = MEASURED.get(stem)
    if channel is None or not channel.dims:
        return None
    if channel.dims == ("axis",):
        return Label(stem, part) if part in ("x", "y") else None
    return Label(stem, int(part)) if part.isdigit() and int(part) > 0 else None


def check_label(name: str, text: str) -> Label:
    """Return the label of a name; InputError if no channel has it."""
    label = label_of(text)
    if label is None:
        channel = MEASURED.get(text)
        example = "_x" if channel and channel.dims == ("axis",) else "_1"
        hint = f"Add its number or axis: {text}{example}." if channel else nearest(text, MEASURED)
        rule = "be the name of a measured channel, such as joint_angle_1, strain_2 or tip_x"
        raise InputError(Problem(name, rule, shown(text), hint))
    return label


def split_unit(header: str) -> tuple[str, str]:
    """Return name and unit of the header of a column: ``angle [deg]``, ``angle (deg)``."""
    match = _UNIT.match(header)
    # A number in brackets without a space before them is the index of a column of an array.
    if match is None or (match[3].isdigit() and not match[2]):
        return header, ""
    return match[1], match[3]


def factor_of(name: str, unit: str, si: str) -> float:
    """Return the factor from a unit to the SI unit of a channel; InputError if it is not one."""
    known = UNITS[si]
    if unit not in known:
        rule = f"be a unit of its channel ({', '.join(known)})"
        raise InputError(Problem(name, rule, shown(unit)))
    return known[unit]


def dataset_of(times: np.ndarray, columns: dict[Label, np.ndarray]) -> xr.Dataset:
    """Return a record as a dataset over ``time``; parts that were not measured are missing."""
    variables = {}
    coordinates: dict[str, object] = {"time": ("time", times, {"units": "s", "long_name": "time"})}
    for name in dict.fromkeys(label.channel for label in columns):
        channel = MEASURED[name]
        own = sorted((label for label in columns if label.channel == name), key=str)
        own.sort(key=lambda label: label.part)
        values = np.stack([columns[label] for label in own], axis=1)
        attributes = {"units": channel.unit, "long_name": channel.meaning}
        if not channel.dims:
            variables[name] = xr.DataArray(values[:, 0], dims="time", attrs=attributes)
            continue
        dimension = channel.dims[0]
        parts = {dimension: [label.part for label in own]}
        dims = ("time", dimension)
        variables[name] = xr.DataArray(values, dims=dims, coords=parts, attrs=attributes)
    return xr.Dataset(variables).assign_coords(coordinates)


def columns_of(data: xr.Dataset, names: Collection[str]) -> dict[Label, np.ndarray]:
    """Return the columns (samples,) of channels of a record or of a result."""
    columns: dict[Label, np.ndarray] = {}
    for name in names:
        values = np.asarray(data[name].values, dtype=np.float64)
        if values.ndim == 1:
            columns[Label(name, "")] = values
            continue
        parts = data[name][MEASURED[name].dims[0]].values
        if MEASURED[name].dims == ("gauge",) and parts.dtype.kind not in "iu":
            parts = np.arange(1, len(parts) + 1)  # results name gauges by their places
        columns |= {
            Label(name, part): column for part, column in zip(parts.tolist(), values.T, strict=True)
        }
    return {label: c for label, c in columns.items() if not np.all(np.isnan(c))}


def place_of(arm: Arm, label: Label) -> int:
    """Return the index of a label in the last axis of its channel; InputError if there is none."""
    dims = MEASURED[label.channel].dims
    if not dims:
        return 0
    if dims == ("axis",):
        return ["x", "y"].index(str(label.part))
    known = {
        "joint": arm.joint_numbers.tolist(),
        "link": list(range(1, arm.links + 1)),
        "gauge": list(range(1, len(arm.gauges) + 1)),
    }[dims[0]]
    if label.part not in known:
        numbers = ", ".join(map(str, known)) or "there are none"
        rule = f"names a {dims[0]} that the arm does not have ({numbers})"
        raise InputError(Problem(label.text, rule))
    return int(known.index(label.part))
