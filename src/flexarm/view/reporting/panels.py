"""Histories of a report: the main channels, energies and the error of the tip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.view.plot.animation.scene import thin
from flexarm.view.plot.selection import USUAL, Signals, readable_unit, several, signals_of
from flexarm.view.reporting.measures import energies, tip_error

if TYPE_CHECKING:
    import xarray as xr

#: Default channels, of those that a result has, after the usual ones.
_FURTHER = (
    "joint_rate",
    "tip",
    "torque_command",
    "joint_twist",
    "strain",
    "contact_force",
    "contact_gap",
)
_MOST_LINES = 12
#: Limit on the numbers of all histories, so that they take about 1.5 megabytes.
_MOST_NUMBERS = 200_000


def panels(result: xr.Dataset, arm: Arm, reference: Any, channels: object) -> list[Signals]:
    """Return the histories of a report.

    Raises:
        InputError: if ``channels`` contains a channel that the result lacks.
    """
    if channels is not None:
        return [few_lines(each) for each in several("channels", channels, result)]
    names = [name for name in (*USUAL, *_FURTHER) if name in result and result[name].size]
    found = [signals_of("result", result, name) for name in names]
    # Twists are zero without elastic joints.
    found = [each for each in found if each.name != "joint_twist" or np.any(each.values)]
    found += [_energy_panel(result)] if "kinetic_energy" in result else []
    if reference is not None:
        found.append(error_panel(result, arm, reference))
    return [few_lines(each) for each in found]


def error_panel(result: xr.Dataset, arm: Arm, reference: Any) -> Signals:
    """Return the distance of the tip from its reference over time."""
    away = tip_error(arm, reference, result)
    return _readable(Signals("tip_error", result["time"].values, away[:, None], "m", ("",), ("",)))


def _energy_panel(result: xr.Dataset) -> Signals:
    parts = energies(result)
    values = np.stack(list(parts.values()), axis=1)
    labels = tuple(parts)
    return _readable(Signals("energy", result["time"].values, values, "J", labels, labels))


def _readable(signals: Signals) -> Signals:
    scale, unit = readable_unit(signals.unit, signals.values)
    return replace(signals, values=scale * signals.values, unit=unit)


def few_lines(signals: Signals) -> Signals:
    """Return at most twelve lines, evenly chosen with the first and the last."""
    count = len(signals.labels)
    if count <= _MOST_LINES:
        return signals
    kept = np.linspace(0, count - 1, _MOST_LINES).round().astype(int)
    labels, keys = (tuple(each[k] for k in kept) for each in (signals.labels, signals.keys))
    return replace(signals, values=signals.values[:, kept], labels=labels, keys=keys)


def fitted(histories: Sequence[Signals]) -> list[Signals]:
    """Return histories with few enough points for the page; peaks are kept."""
    share = _MOST_NUMBERS // max(1, len(histories))
    return [
        thin(each, max(1, share // ((1 + each.values.shape[1]) * (1 + 2 * each.values.shape[1]))))
        for each in histories
    ]
