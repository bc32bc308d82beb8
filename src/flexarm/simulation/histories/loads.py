"""Time histories of loads: load factors and base acceleration as piecewise cubics."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.actions.environment import Environment
from flexarm.arm.actions.loads import parts_of
from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_function
from flexarm.base.errors import InputError
from flexarm.integrate.base import FloatArray
from flexarm.kernels.layout import Contacts, Loads
from flexarm.model import AccelerationTable, FactorTable, Load
from flexarm.model.environment.tables import is_table
from flexarm.simulation.histories.functions import Row, function_history
from flexarm.simulation.histories.piecewise import PiecewiseCubic


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """Placed loads of a run and their factors over time."""

    owners: list[Load]  # the load that each placed part belongs to
    placed: Loads  # the parts, placed on the arm
    factors: PiecewiseCubic  # factors (parts,) and base acceleration (2,) over time, in one row

    def stops_with(self, torque: PiecewiseCubic) -> FloatArray:
        """Return the times (s) at which the loads or a torque history are not smooth, sorted."""
        return np.unique(np.concatenate([torque.stops, self.factors.stops]))


def load_history(
    arm: Arm,
    environment: Environment,
    duration: float,
    relative: float,
    contacts: Contacts | None = None,
    breaks: ArrayLike = (),
    spacing: float | None = None,
    known: dict[tuple[int, ...], PiecewiseCubic] | None = None,
) -> LoadHistory:
    """Place the loads and approximate their time dependence; tables are represented exactly.

    Args:
        contacts: contacts of the environment as they were placed for the run, if there are any.
        breaks, spacing: of functions of time, as in ``function_history``.
        known: factors of earlier calls that differ in the arm alone, for reuse.

    Raises:
        InputError: if a load is not on the arm, a function does not return numbers, or a table
            is not valid.
    """
    loads, base_acceleration = environment.loads, _base(environment.base_acceleration)
    moving = callable(base_acceleration) or isinstance(base_acceleration, AccelerationTable)
    still = Environment(loads, None if moving else base_acceleration)
    placed = still.placed(arm)
    if contacts is not None:
        placed = placed._replace(contacts=contacts)
    owners = parts_of(arm, loads)
    known, key = {} if known is None else known, tuple(map(id, owners))
    if not moving and all(load.factor is None for load in loads):
        known.setdefault(key, PiecewiseCubic.constant(np.zeros(0)))
    if key in known:
        return LoadHistory(owners, placed, known[key])
    if callable(base_acceleration):
        name = "base_acceleration"
        check_function(name, base_acceleration)
        base = function_history(base_acceleration, duration, 2, relative, breaks, name, spacing)
    elif isinstance(base_acceleration, AccelerationTable):
        base = interpolated(base_acceleration)
    else:
        base = PiecewiseCubic.constant(placed.base_acceleration)

    def factor(load: Load) -> PiecewiseCubic:
        """Return the factor of a load over time, in one column."""
        if load.factor is None:
            return PiecewiseCubic.constant(np.ones(1))
        if isinstance(load.factor, FactorTable):
            return interpolated(load.factor)
        assert callable(load.factor)
        row, name = Row(load.factor), "Load.factor"
        return function_history(row, duration, 1, relative, breaks, name, spacing)

    followed = {id(load): factor(load) for load in loads}
    columns = [followed[id(load)] for load in owners]
    known[key] = PiecewiseCubic.joined([*columns, base])
    return LoadHistory(owners, placed, known[key])


def _base(given: Any) -> Any:
    """Return the acceleration of the base with a pair (times, values) as a checked table."""
    if not is_table(given):
        return given
    try:
        return AccelerationTable(times=given[0], values=given[1])
    except InputError as error:
        own = "base_acceleration"
        named = (replace(p, where="", name=f"{own}.{p.name}") for p in error.problems)
        raise InputError(*named) from None


def interpolated(table: FactorTable | AccelerationTable) -> PiecewiseCubic:
    """Interpolate a table linearly, in one column, or in two for an acceleration."""
    times = np.array(table.times)
    return PiecewiseCubic.table(times, np.array(table.values).reshape(times.size, -1))
