"""Time histories of loads: load factors and base acceleration as piecewise cubics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arguments import check_function
from flexarm.arm import Arm
from flexarm.histories.functions import Row, function_history
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.kernels.layout import Contacts, Loads
from flexarm.loads import Load, Table, check_table, is_table, parts_of, place_loads

BaseAcceleration = ArrayLike | Callable[[float], ArrayLike] | Table


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """Placed loads of a run and their factors over time.

    Attributes:
        owners: the load that each placed part belongs to.
        placed: the parts, placed on the arm.
        factors: factors (parts,) and base acceleration (2,) over time, in one row.
    """

    owners: list[Load]
    placed: Loads
    factors: PiecewiseCubic


def load_history(
    arm: Arm,
    loads: Sequence[Load],
    base_acceleration: BaseAcceleration | None,
    duration: float,
    relative: float,
    contacts: Contacts | None = None,
    where: str = "simulate",
    breaks: ArrayLike = (),
    spacing: float | None = None,
) -> LoadHistory:
    """Place the loads and approximate their time dependence; tables are represented exactly.

    Args:
        contacts: contacts already placed, which are only added to the loads.
        where: name of the calling function, for messages.
        breaks, spacing: of functions of time, as in ``function_history``.

    Raises:
        InputError: if a load is not on the arm, a function does not return numbers, or a table
            is not valid.
    """
    moving = callable(base_acceleration) or is_table(base_acceleration)
    constant: Any = None if moving else base_acceleration
    placed = place_loads(arm, where, loads, constant)
    if contacts is not None:
        placed = placed._replace(contacts=contacts)
    owners = parts_of(arm, loads)
    if not moving and all(load.factor is None for load in loads):
        nothing = PiecewiseCubic.constant(np.zeros(0))
        return LoadHistory(owners, placed, nothing)
    if callable(base_acceleration):
        name = "base_acceleration"
        check_function(where, name, base_acceleration)
        base = function_history(
            base_acceleration, duration, 2, relative, breaks, name, where, spacing
        )
    elif is_table(base_acceleration):
        base = PiecewiseCubic.table(*check_table(where, "base_acceleration", base_acceleration, 2))
    else:
        base = PiecewiseCubic.constant(placed.base_acceleration)

    def factor(load: Load) -> PiecewiseCubic:
        """Return the factor of a load over time, in one column."""
        if load.factor is None:
            return PiecewiseCubic.constant(np.ones(1))
        if not callable(load.factor):
            return PiecewiseCubic.table(*check_table("Load", "factor", load.factor, 1))
        row, name = Row(load.factor), "Load.factor"
        return function_history(row, duration, 1, relative, breaks, name, where, spacing)

    followed = {id(load): factor(load) for load in loads}
    columns = [followed[id(load)] for load in owners]
    return LoadHistory(owners, placed, PiecewiseCubic.joined([*columns, base]))
