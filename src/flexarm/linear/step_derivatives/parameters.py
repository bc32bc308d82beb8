"""Exact derivatives of the constants of an arm by its parameters, from scaling laws.

If a whole link becomes stiffer, heavier or longer by a factor, its mode shapes keep their form:
only amplitudes and frequencies change, by powers of the factor. No derivative of an eigenvector is
needed, and the derivatives are exact for reduced modes too; theory page "separation", (D.15).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import constants_of_links, place_joints_and_payload
from flexarm.arm.stations import place_gauges
from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.model import ArmSpec, Link
from flexarm.model.paths import number_at, number_paths, with_number

#: Exponents of the constants of a body for a factor on its whole link. Constants that are not
#: listed do not change. They are constants of the link about its root, without the hub.
POWERS: dict[str, dict[str, Any]] = {}
_SHAPES = "S", "a", "P", "dP", "w2", "G"
_SCALED = "mass", "first_moment_x", "inertia", "inverse_mass", "inverse_inertia", *_SHAPES
_BY_LENGTH = 1.0, 2.0, 3.0, -1.0, -3.0, 0.5, 1.5, -0.5, -1.5, -4.0, -2.0
_BY_MASS = 1.0, 1.0, 1.0, -1.0, -1.0, 0.5, 0.5, -0.5, -0.5, -1.0, -1.0
POWERS["length"] = {"length": 1.0, "D0": -1.0, "N": (-1.0, -2.0, -3.0)}
POWERS["length"] |= dict(zip(_SCALED, _BY_LENGTH, strict=True))
POWERS["length"] |= {"residual_inertia": (1.0, 2.0, 3.0), "residual_tip": (0.0, 1.0, -1.0, 0.0)}
POWERS["mass"] = {"residual_inertia": 1.0, "N": -1.0, **dict(zip(_SCALED, _BY_MASS, strict=True))}
POWERS["rigidity"] = {"w2": 1.0}
#: Relative tolerance for rounding between formula and arm. Both start from the same numbers, and a
#: factor of four is exact in binary, but the computation of sections rounds.
_ROUNDING = 1e-9
#: Largest number of paths in the hint of a message.
_MOST_LISTED = 12


def constants_at(
    arm: Arm, values: Mapping[str, Any], dtype: Any = object
) -> tuple[ArmConstants, Array]:
    """Return the constants and the rows of gauges (gauges, m) for numbers or symbols by path.

    Numbers of joints, payload, gravity, gauges and damping enter the constants through the formulas
    of ``assemble``. Numbers of a link enter through its modes: if a number scales the link's
    rigidity, mass or length as a whole, the mode shapes do not change. There is no formula for any
    other number of a link.
    """
    spec = arm.spec
    for path, value in values.items():
        spec = with_number(spec, path, value, checked=False)
    scales = [scales_of(arm.spec.links[i], spec.links[i]) for i in range(arm.n_links)]
    constants = _scaled_constants(arm, spec, scales, dtype)
    if constants.is_tree and not arm.assembly.constants.is_tree:
        rule = "is not supported for an arm whose joints are all on the tips of links"
        raise InputError(Problem(next(path for path in values if ".offset" in path), rule))
    return constants, _gauge_rows(arm, spec, scales, dtype)


def _is_closed_form(arm: Arm, path: str) -> bool:
    """Return whether the constants by formula equal those of an arm with another value."""
    value = number_at("", arm.spec, path)
    for other in (4.0 * value, 0.25 * value) if value else (0.25, -0.25):
        try:
            changed = Arm(with_number(arm.spec, path, other))
        except InputError:  # the model limits this number on one side
            continue
        constants, rows = constants_at(arm, {path: other}, float)
        places = arm.assembly.coordinates, changed.assembly.coordinates
        exact = (*changed.assembly.constants, place_gauges(changed, changed.gauges)[0])
        return np.array_equal(*places) and same_arrays(exact, (*constants, rows), _ROUNDING)
    return False


def check_closed_form(name: str, arm: Arm, path: str) -> None:
    """Raise unless ``constants_at`` has a formula for the number at a path."""
    if _is_closed_form(arm, path):
        return
    rule = "be a parameter whose effect on the equations has a closed form"
    if number_at(name, arm.spec, path) == 0.0:
        hint = "It is 0 in this arm: the equations omit its terms, or no other value is valid."
        raise InputError(Problem(name, rule, shown(path), hint))
    root = path.partition(".")[0]
    near = [p for p in number_paths(arm.spec) if p.partition(".")[0] == root]
    possible = [p for p in near[:64] if _is_closed_form(arm, p)]
    listed = ", ".join(possible[:_MOST_LISTED]) or "none"
    hint = (
        f"It changes the form of the modes of a link, or moves a gauge. Possible for {root}: "
        f"{listed}. For other values create another Arm."
    )
    raise InputError(Problem(name, rule, shown(path), hint))


def _scaled_constants(
    arm: Arm, spec: ArmSpec, scales: Sequence[Mapping[str, Any]], dtype: Any
) -> ArmConstants:
    """Return constants with the factors ``scales`` of whole links, and the joints of ``spec``."""
    pieces = arm.assembly.pieces
    own = constants_of_links(arm.spec, pieces)
    constants = ArmConstants(*(array.astype(dtype) for array in own))
    for piece in pieces:
        for law, factor in scales[piece.link].items():
            for field, power in POWERS[law].items():
                column = getattr(constants, field)
                column[piece.body] = scaled(column[piece.body], factor, power)
    place_joints_and_payload(constants, spec, pieces, arm.assembly.seats)
    return constants


def same_arrays(one: Iterable[Array], other: Iterable[Array], tolerance: float) -> bool:
    """Return whether arrays agree, relative to the largest number of each column.

    A column has one unit, and small entries may be rounding of larger ones.
    """
    for a, b in zip(one, other, strict=True):
        largest = np.abs(a).max(axis=tuple(range(a.ndim - 1)), initial=0.0)
        if a.shape != b.shape or np.any(~(np.abs(a - b) <= tolerance * largest)):
            return False
    return True


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
