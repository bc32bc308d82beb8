"""Loads over time: their factors and the base's acceleration as piecewise cubics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm import Arm
from flexarm.integrate.base import FloatArray
from flexarm.kernels.layout import Loads
from flexarm.loads import Load, parts_of, place_loads
from flexarm.simulate.torque_history import TorqueHistory, function_torque


@dataclass(frozen=True, eq=False)
class LoadHistory:
    """Placed loads with the loads they are parts of, and over time factors (parts,) of them and
    base acceleration (2,), in one row."""

    owners: list[Load]
    placed: Loads
    factors: TorqueHistory


def load_history(
    arm: Arm,
    loads: Sequence[Load],
    base_acceleration: ArrayLike | Callable[[float], ArrayLike] | None,
    duration: float,
    relative: float,
) -> LoadHistory:
    """Place the loads and follow whatever of them changes with time.

    Raises:
        InputError: a load is not on the arm, or a function returns something else than numbers.
    """
    constant = None if callable(base_acceleration) else base_acceleration
    placed = place_loads(arm, "simulate", loads, constant)
    owners = parts_of(arm, loads)
    if not callable(base_acceleration) and all(load.factor is None for load in owners):
        nothing = TorqueHistory(np.array([0.0, 1.0]), np.zeros((1, 4, 0)), np.zeros(0))
        return LoadHistory(owners, placed, nothing)
    still = placed.base_acceleration.copy()

    def row(t: float) -> FloatArray:
        factors = [1.0 if load.factor is None else load.factor(t) for load in owners]
        base = base_acceleration(t) if callable(base_acceleration) else still
        return np.concatenate([factors, np.asarray(base, dtype=np.float64)])

    history = function_torque(row, duration, len(owners) + 2, relative)
    return LoadHistory(owners, placed, history)
