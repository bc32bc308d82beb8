"""Loads, contacts and base acceleration of a scenario as arguments of ``simulate``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from flexarm.contacts import Contact
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray
from flexarm.loads import Load, check_table
from flexarm.model import AccelerationTable, LoadSpec, Scenario
from flexarm.model.contacts import RoundWallSpec, SurfaceSpec, WallSpec
from flexarm.surfaces import RoundWall, Surface, SurfaceTable, Wall


def loads_of(specs: Sequence[LoadSpec]) -> list[Load]:
    """Return the loads of a file."""
    return [_load(spec) for spec in specs]


def contacts_of(scenario: Scenario) -> list[Contact]:
    """Return the scenario's contacts."""
    names = ("stiffness", "link", "station", "exponent", "damping", "friction", "friction_speed")
    return [
        Contact(_surface(spec.surface), **{name: getattr(spec, name) for name in names})
        for spec in scenario.contacts
    ]


def _surface(spec: SurfaceSpec) -> Surface:
    if isinstance(spec, WallSpec):
        return Wall(spec.point, spec.normal)
    if isinstance(spec, RoundWallSpec):
        return RoundWall(spec.center, spec.radius, spec.inside)
    return SurfaceTable(spec.x, spec.y, spec.closed)


def base_acceleration_of(scenario: Scenario) -> Any:
    """Return the base's acceleration: (ax, ay), a table of times and values, or None."""
    given = scenario.base_acceleration
    if isinstance(given, AccelerationTable):
        return given.times, given.values
    return given


def loads_at_start(scenario: Scenario) -> list[Load]:
    """Return the scenario's loads with their constant values at time zero."""
    loads = []
    for load in loads_of(scenario.loads):
        now = 1.0 if load.factor is None else float(_at_start("factor", load.factor, 1)[0])
        force, moment = now * np.asarray(load.force), now * load.moment
        loads.append(replace(load, force=force, moment=moment, factor=None))
    return loads


def base_acceleration_at_start(scenario: Scenario) -> FloatArray | None:
    """Return the base's acceleration (2,) at time zero, m/s^2, or None."""
    given = scenario.base_acceleration
    if isinstance(given, AccelerationTable):
        return _at_start("base_acceleration", base_acceleration_of(scenario), 2)
    return None if given is None else np.array(given)


def _at_start(name: str, table: object, columns: int) -> FloatArray:
    """Return the values (columns,) of a table at time zero; at a jump, the values after it."""
    times, values = check_table("scenario", name, table, columns)
    row: FloatArray = PiecewiseCubic.table(times, values).at(np.zeros(1))[0]
    return row


def _load(spec: LoadSpec) -> Load:
    return Load(
        link=spec.link,
        force=spec.force or (0.0, 0.0),
        moment=spec.moment or 0.0,
        station=spec.station,
        spread=spec.spread,
        frame=spec.frame,
        factor=None if spec.factor is None else (spec.factor.times, spec.factor.values),
    )
