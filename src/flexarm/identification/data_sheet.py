"""Free parameters of an arm with bounds and priors relative to its data sheet."""

from __future__ import annotations

from collections.abc import Collection

from flexarm.base.errors import InputError
from flexarm.identification.record import Label
from flexarm.model import ArmSpec, Motors
from flexarm.model.checks import Record
from flexarm.model.identification import FreeParameter
from flexarm.model.paths import number_at

#: Lower and upper bounds, and deviations of priors, relative to the data sheet.
_RIGIDITY, _GAUGE, _MASS = (0.3, 1.2, None), (0.7, 1.3, 0.15), (0.9, 1.1, 0.05)
_DRIVE, _SPRING, _LOOSE = (0.3, 3.0, 0.3), (0.3, 3.0, None), (0.05, 20.0, None)

Parameters = dict[str, FreeParameter]


def of_links(spec: ArmSpec, measured: Collection[Label]) -> Parameters:
    """Return rigidities, damping of links, and distances of the gauges in the records."""
    items: list[FreeParameter | None] = []
    number = 0
    for k, link in enumerate(spec.links):
        rigidity = _relative(spec, f"links[{k}].flexural_rigidity", _RIGIDITY)
        items.append(rigidity or _relative(spec, f"links[{k}].material.youngs_modulus", _RIGIDITY))
        for name in ("stiffness_coefficient", "ratio"):
            items.append(_relative(spec, f"links[{k}].damping.{name}", _LOOSE))
        for gauge in range(len(link.gauges)):
            number += 1
            if Label("strain", number) in measured:
                items.append(_relative(spec, f"links[{k}].gauges[{gauge}].distance", _GAUGE))
    return _by_path(items)


def of_drives(spec: ArmSpec, motors: Motors | None, prescribed: Collection[int]) -> Parameters:
    """Return inertias, stiffnesses, damping, friction and motors of joints not prescribed."""
    items: list[FreeParameter | None] = []
    for number, k in enumerate(driven_joints(spec), start=1):
        joint, place = spec.joints[k], f"joints[{k}]"
        if number in prescribed:
            continue
        # Both inertias of a rigid joint act as their sum.
        rotor = joint.rotor_inertia * joint.gear_ratio**2 > joint.hub_inertia or joint.elastic
        items.append(_relative(spec, f"{place}.{'rotor' if rotor else 'hub'}_inertia", _DRIVE))
        items.append(_relative(spec, f"{place}.stiffness", _SPRING))
        for name in ("coulomb", "coulomb_negative"):
            items.append(_relative(spec, f"{place}.friction.{name}", _LOOSE))
        viscous = joint.friction is not None and joint.friction.viscous > 0.0
        items.append(FreeParameter(f"{place}.{'friction.viscous' if viscous else 'damping'}"))
        if motors is not None and isinstance(motors.torque_constant, tuple | list):
            items.append(_relative(motors, f"torque_constant[{number - 1}]", _GAUGE, "motors."))
    if motors is not None:
        items.append(_relative(motors, "torque_constant", _GAUGE, "motors."))
    return _by_path(items)


def of_masses(spec: ArmSpec) -> Parameters:
    """Return masses of links, motors and payload."""
    paths = [f"links[{k}].mass_per_length" for k in range(len(spec.links))]
    paths += [f"joints[{k}].mass" for k in range(len(spec.joints))]
    return _by_path([_relative(spec, path, _MASS) for path in [*paths, "payload.mass"]])


def driven_joints(spec: ArmSpec) -> list[int]:
    """Return the indices of the joints that have a number, the fixed ones left out."""
    return [k for k, joint in enumerate(spec.joints) if not joint.fixed]


def _relative(
    record: Record, path: str, limits: tuple[float, float, float | None], start: str = ""
) -> FreeParameter | None:
    """Return a parameter with bounds and a prior relative to its value; None if it has none."""
    try:
        value = number_at("free", record, path)
    except InputError:
        return None
    if value == 0.0:
        return None
    lower, upper = sorted((limits[0] * value, limits[1] * value))
    parameter = FreeParameter(start + path, lower=lower, upper=upper)
    if limits[2] is None:
        return parameter
    return parameter.replace(prior=value, prior_deviation=limits[2] * abs(value))


def _by_path(items: list[FreeParameter | None]) -> Parameters:
    return {item.path: item for item in items if item is not None}
