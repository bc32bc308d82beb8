"""Constants of an arm as formulas of parameters, which are identified by paths in its file.

Numbers of joints, payload, gravity, gauges and damping enter the constants through the formulas of
``assemble``, which are evaluated over symbols or complex numbers. Numbers of a link enter through
its modes. If a number scales the link's rigidity, mass or length as a whole, the mode shapes do not
change, and the constants are proportional to powers of the scale factor; theory page "separation",
(D.15). Any other number of a link changes the mode shapes, for which there is no formula.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import constants_of_links, place_joints_and_payload
from flexarm.arm.stations import place_gauges
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.linear.step_derivatives.parameters import POWERS
from flexarm.model import ArmSpec, Link
from flexarm.model.paths import with_number


def constants_at(
    arm: Arm, values: Mapping[str, Any], dtype: Any = object
) -> tuple[ArmConstants, Array]:
    """Return the constants and the rows of gauges (gauges, m) for values of parameters.

    Args:
        values: numbers or symbols by path.
        dtype: number type of the arrays.
    """
    spec, assembly = arm.spec, arm.assembly
    for path, value in values.items():
        spec = with_number(spec, path, value, checked=False)
    own = constants_of_links(arm.spec, assembly.pieces)
    constants = ArmConstants(*(array.astype(dtype) for array in own))
    scales = [scales_of(arm.spec.links[i], spec.links[i]) for i in range(arm.links)]
    for piece in assembly.pieces:
        for law, factor in scales[piece.link].items():
            for field, power in POWERS[law].items():
                column = getattr(constants, field)
                column[piece.body] = scaled(column[piece.body], factor, power)
    place_joints_and_payload(constants, spec, assembly.pieces, assembly.seats)
    return constants, _gauge_rows(arm, spec, scales, dtype)


def _gauge_rows(arm: Arm, spec: ArmSpec, scales: list[dict[str, Any]], dtype: Any) -> Array:
    at_unit_distance = [(i, station, 1.0) for i, station, _ in arm.gauges]
    rows = place_gauges(arm, at_unit_distance)[0].astype(dtype)
    distances = [gauge.distance for link in spec.links for gauge in link.gauges]
    for row, distance, (i, _, _) in zip(rows, distances, arm.gauges, strict=True):
        # Mode shapes are mass-normalised, so they scale with the mass as the shapes at the tip do.
        mass = scales[i].get("mass", 1.0)
        row[:] = scaled(row * distance, mass, POWERS["mass"]["P"])
    return rows


def scales_of(link: Link, changed: Link) -> dict[str, Any]:
    """Return the factors on a link's length, mass and rigidity, by the names of `POWERS`."""
    if changed is link:
        return {}
    factors = {}
    tables = link.beam(), changed.beam()
    laws = {"length": "x", "rigidity": "flexural_rigidity", "mass": "mass_per_length"}
    for law, column in laws.items():
        before, after = (getattr(table, column) for table in tables)
        if before is None or after is None:
            continue
        place = next((k for k in reversed(range(len(before))) if before[k]), None)
        if place is not None and after[place] is not before[place]:
            factors[law] = after[place] / before[place]
    return factors


def scaled(value: Any, factor: Any, power: Any) -> Any:
    """Multiply a number or an array by a power of a factor; a tuple has one power per entry."""
    if isinstance(power, tuple):
        return [number * factor**one for number, one in zip(value, power, strict=True)]
    return value * factor**power
