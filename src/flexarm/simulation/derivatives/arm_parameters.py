"""Derivatives of the numbers of an arm by a parameter, which is identified by its path.

Where the parameter has a formula (``formulas``), the derivative is exact: the formula is evaluated
at a complex number. Other numbers of a link change the form of its modes. Their derivative is the
central difference of order 8 of ``assemble``, whose error is estimated by that of order 6.
"""

from __future__ import annotations

import numpy as np

from flexarm.arm.actions.environment import Environment
from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem, shown
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import Array
from flexarm.linear.step_derivatives.parameters import POWERS, constants_at, scaled, scales_of
from flexarm.model import Link
from flexarm.model.paths import number_at, parts_of, with_number
from flexarm.simulation.derivatives.differences import SMOOTH, differences
from flexarm.simulation.derivatives.inputs import ArmInputs, arm_inputs

#: Change of a number that is zero, and the relative tolerance of its derivative in this comparison.
_PROBE, _PROBED = 1e-4, 0.05
#: Columns of a table that must keep their ratio.
_STIFFNESSES = "flexural_rigidity", "shear_rigidity"
_INERTIAS = "mass_per_length", "rotary_inertia_per_length"
#: Relative tolerance for rounding of the columns of two tables.
_SAME = 1e-12


def arm_derivative(name: str, arm: Arm, environment: Environment, path: str) -> ArmInputs:
    """Return the derivatives of ``arm_inputs`` by the number at a path.

    Args:
        name: name of the argument, for messages.

    Raises:
        InputError: if the path is not that of a number, or the numbers are not differentiable.
    """
    value = number_at(name, arm.spec, path)
    if not _has_formula(arm, environment, path, value):
        if value == 0.0:
            hint = "It is 0 in this arm. Give it another value."
            raise InputError(Problem(name, SMOOTH, shown(path), hint))
        return ArmInputs(
            *differences(
                name, path, value, abs(value), lambda v: _moved(name, arm, environment, path, v)
            )
        )
    found = _by_formula(arm, environment, path, value)
    if value == 0.0:
        _check_zero(name, arm, environment, path, found)
    return found


def _has_formula(arm: Arm, environment: Environment, path: str, value: float) -> bool:
    """Return whether the constants depend on a number by the formulas of ``constants_at``."""
    parts = parts_of(path)
    if parts[0] != "links":
        return True
    link, field = int(parts[1]), parts[2]
    if field == "damping":
        return True
    if field == "hub_radius":
        return not _has_points(environment, link)
    if field == "gauges":
        return parts[-1] == "distance"
    try:
        changed = with_number(arm.spec, path, 2.0 * value, checked=False).links[link]
        return value != 0.0 and _keeps_shapes(arm, environment, link, changed)
    except (TypeError, ValueError):  # a section whose formulas do not accept this number
        return False


def _keeps_shapes(arm: Arm, environment: Environment, link: int, changed: Link) -> bool:
    """Return whether the mode shapes of a link keep their form if it is replaced by another one.

    They do if rigidity, mass and length are each multiplied by a factor; theory page "separation",
    (D.15). A length must not move points at given stations, either.
    """
    tables = arm.spec.links[link].beam(), changed.beam()
    factors = {}
    for column in ("x", *_STIFFNESSES, *_INERTIAS):
        before, after = (np.array(getattr(table, column) or (), dtype=float) for table in tables)
        there = before != 0.0
        ratio = after[there] / before[there]
        if np.any(after[~there]) or (ratio.size and np.ptp(ratio) > _SAME * ratio[0]):
            return False
        if ratio.size:
            factors[column] = float(ratio[0])
    for pair in (_STIFFNESSES, _INERTIAS):
        own = [factors[column] for column in pair if column in factors]
        if own and max(own) - min(own) > _SAME * own[0]:
            return False
    if factors["x"] == 1.0:
        return True
    shaped = "shear_rigidity" in factors or "rotary_inertia_per_length" in factors
    return not (shaped or _has_points(environment, link) or arm.spec.links[link].gauges)


def _has_points(environment: Environment, link: int) -> bool:
    """Return whether loads or contacts act on a link, counted from 0."""
    points = *environment.loads, *environment.contacts
    return any(getattr(point, "link", None) in (None, link + 1) for point in points)


def _by_formula(arm: Arm, environment: Environment, path: str, value: float) -> ArmInputs:
    given = value + 1j * STEP
    constants, gauges = constants_at(arm, {path: given}, complex)
    spec = with_number(arm.spec, path, given, checked=False)
    masses = [
        scales_of(old, new).get("mass", 1.0)
        for old, new in zip(arm.spec.links, spec.links, strict=True)
    ]
    loads = Environment(environment.loads, None, environment.contacts).placed(arm)

    def shapes(array: Array, body: Array, power: float) -> Array:
        """Scale shapes (k, ...) at points of links, which are mass-normalised, with the mass."""
        moved = array.astype(complex)
        for row, owner in zip(moved, body, strict=True):
            row[...] = scaled(row, masses[arm.assembly.piece_of(owner).link], power)
        return moved

    shape, square = POWERS["mass"]["P"], POWERS["mass"]["G"]
    points = loads.contacts
    moved = ArmInputs(
        *constants,
        gauges,
        loads.weight,
        loads.lever,
        shapes(loads.rows, loads.body, shape),
        shapes(loads.slopes, loads.body, shape),
        shapes(loads.shortening, loads.body, square),
        shapes(points.rows, points.body, shape),
        shapes(points.shortening, points.body, square),
        points.law,
    )
    return ArmInputs(*(np.imag(array) / STEP for array in moved))


def _moved(name: str, arm: Arm, environment: Environment, path: str, value: float) -> ArmInputs:
    """Return the numbers of the arm with another value of a parameter.

    Raises:
        InputError: if the value is not possible, or changes the number of coordinates.
    """
    try:
        changed = Arm(with_number(arm.spec, path, value))
        found = arm_inputs(changed, environment)
    except InputError as error:
        hint = str(error.problems[0])
        rule = "be a number that can change by a few per cent"
        raise InputError(Problem(name, rule, shown(path), hint)) from None
    return found


def _check_zero(name: str, arm: Arm, environment: Environment, path: str, found: ArmInputs) -> None:
    """Raise if the equations omit the terms of a number that is zero.

    Raises:
        InputError: if the numbers of the arm do not change as their derivatives ``found`` predict.
    """
    before = arm_inputs(arm, environment)
    for change in (_PROBE, -_PROBE):
        try:
            after = _moved(name, arm, environment, path, change)
        except InputError:  # the model limits this number on one side
            continue
        if all(
            new.shape == old.shape
            and np.allclose((new - old) / change, slope, rtol=_PROBED, atol=_PROBED)
            for old, new, slope in zip(before, after, found, strict=True)
        ):
            return
    hint = "It is 0 in this arm, so that the equations omit its terms. Give it another value."
    raise InputError(Problem(name, SMOOTH, shown(path), hint))
