"""Arrays of ``integrate.lanes`` for the runs of a batch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.integrate.lanes.data import LaneDrive
from flexarm.integrate.lanes.stepper import CONTACT_PLACES, LOAD_PLACES, LOAD_VALUES
from flexarm.kernels.layout import ArmConstants, Contacts, Loads
from flexarm.simulation.histories.loads import LoadHistory
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.tolerance import absolute_tolerance, tip_units


def arms_of_runs(
    arms: Sequence[Arm], loads: Sequence[Loads], atol: float | None, horizon: float
) -> tuple[ArmConstants, FloatArray, Loads, Contacts]:
    """Return constants, units of the tolerance, loads and contacts, in the form of ``LaneRuns``.

    Args:
        arms: of each run, or one of all.
        loads: of each run, on the same bodies. With one arm, only the contacts differ.
        atol, horizon: of all runs, see ``tolerance_of``.
    """
    found = [arm.assembly.constants for arm in arms]
    constants = ArmConstants(*(np.stack(arrays) for arrays in zip(*found, strict=True)))
    scales = [absolute_tolerance(arm, atol, 1.0)[1] for arm in arms]
    units = np.stack([tip_units(*pair, horizon) for pair in zip(arms, scales, strict=True)])
    touching = [one.contacts for one in loads]
    contacts = _stacked(touching[: len(arms)], CONTACT_PLACES)
    contacts = contacts._replace(law=np.stack([one.law for one in touching]))
    return constants, units, _stacked(loads[: len(arms)], LOAD_VALUES + LOAD_PLACES), contacts


def _stacked(records: Sequence[Any], names: Sequence[str]) -> Any:
    """Return the first record, with some of its arrays stacked with those of the others."""
    arrays = {name: np.stack([getattr(one, name) for one in records]) for name in names}
    return records[0]._replace(**arrays)


def drive_of_runs(arm: Arm, histories: Sequence[PiecewiseCubic], loads: LoadHistory) -> LaneDrive:
    """Join the torques of the runs; equal objects are stored once.

    Args:
        loads: of all runs.
    """
    different = list({id(history): history for history in histories}.values())
    places, starts = {}, np.zeros(3, dtype=np.int64)
    stops = [loads.stops_with(history) for history in different]
    for history, own in zip(different, stops, strict=True):
        sizes = [history.breaks.size, len(history.coefficients), own.size]
        ends = starts + sizes
        places[id(history)] = np.stack([starts, ends], axis=1).ravel()
        starts = ends
    return LaneDrive(
        breaks=np.concatenate([history.breaks for history in different]),
        coefficients=np.concatenate(
            [arm.padded_torque(history.coefficients) for history in different]
        ),
        stops=np.concatenate(stops),
        places=np.array([places[id(history)] for history in histories]),
        **factors_of(loads),
    )


def factors_of(loads: LoadHistory) -> dict[str, FloatArray]:
    """Return the fields of ``LaneDrive`` for loads."""
    return {
        "amplitude": loads.placed.value,
        "factor_breaks": loads.factors.breaks,
        "factor_coefficients": np.ascontiguousarray(loads.factors.coefficients),
    }
