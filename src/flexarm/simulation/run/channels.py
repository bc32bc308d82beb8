"""Output channels of a result: name, dimensions, unit and meaning of each quantity."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Channel(NamedTuple):
    """One output quantity over time."""

    name: str
    dims: tuple[str, ...]  # besides time
    unit: str
    meaning: str


_TABLE = (
    Channel("joint_angle", ("joint",), "rad", "joint angle, relative to the tip tangent before it"),
    Channel("joint_rate", ("joint",), "rad/s", "rate of the joint angle"),
    Channel("joint_twist", ("joint",), "rad", "twist of an elastic joint's spring, else zero"),
    Channel("bristle_deflection", ("joint",), "rad", "deflection of the bristles of friction"),
    Channel("link_angle", ("link",), "rad", "absolute angle of the link's root tangent"),
    Channel("link_rate", ("link",), "rad/s", "rate of the link angle"),
    Channel("link_tip_deflection", ("link",), "m", "tip deflection from the root tangent"),
    Channel("link_tip_slope", ("link",), "rad", "tip rotation from the root tangent"),
    Channel("link_tip_deflection_rate", ("link",), "m/s", "rate of the tip deflection"),
    Channel("link_tip_slope_rate", ("link",), "rad/s", "rate of the tip rotation"),
    Channel("tip", ("axis",), "m", "position of the arm's tip, world axes"),
    Channel("tip_velocity", ("axis",), "m/s", "velocity of the arm's tip, world axes"),
    Channel("tip_angle", (), "rad", "absolute angle of the last tip tangent"),
    Channel("tip_angle_rate", (), "rad/s", "rate of the tip angle"),
    Channel("torque", ("joint",), "N m", "torque of the joint motors"),
    Channel("torque_command", ("joint",), "N m", "torque requested by the controller"),
    Channel("joint_force", ("link", "axis"), "N", "force of the joint on its link, world axes"),
    Channel("joint_moment", ("link",), "N m", "moment of the joint and its motor on its link"),
    Channel(
        "axial_force", ("link", "station"), "N", "axial force inside the link, tension positive"
    ),
    Channel("shear_force", ("link", "station"), "N", "shear force inside the link"),
    Channel("bending_moment", ("link", "station"), "N m", "moment inside the link, EI v'' at rest"),
    Channel("base_position", ("direction",), "m or rad", "x, y and angle of a base that moves"),
    Channel("base_velocity", ("direction",), "m/s or rad/s", "rates of x, y and angle of the base"),
    Channel("closure_force", ("closure",), "N or N m", "force of a closure on its first point"),
    Channel("kinetic_energy", (), "J", "kinetic energy"),
    Channel("strain_energy", (), "J", "strain energy of bending"),
    Channel("gravity_energy", (), "J", "gravity energy, zero at the base joint"),
    Channel(
        "contact_force", ("contact", "axis"), "N", "force of the surface on the arm, world axes"
    ),
    Channel("contact_gap", ("contact",), "m", "distance from the surface, negative in contact"),
    Channel("contact_energy", ("contact",), "J", "energy stored in the contact"),
    Channel("strain", ("gauge",), "1", "strain at the declared gauges"),
    Channel("q", ("coordinate",), "rad or m kg^0.5", "coordinates: joint angles and modes"),
    Channel("qd", ("coordinate",), "rad/s or m kg^0.5/s", "rates of the coordinates"),
)

#: Units of sliding joints by those of joints that turn.
SLIDING = {"rad": "m", "rad/s": "m/s", "rad/s^2": "m/s^2", "N m": "N"}


def unit_of_part(attributes: Mapping[Any, Any], part: object) -> str:
    """Return the unit of a part of a channel, from attributes in which joints may slide."""
    unit = str(attributes.get("units", ""))
    if "slides" not in attributes:
        return unit
    turning, _, sliding = unit.rpartition(" or ")
    return sliding if str(part) in attributes["slides"].split() else turning


_LIMITS = (
    Channel("loop_growth", (), "1/s", "largest real part of the poles of the sampled loop"),
    Channel("saturation", ("joint",), "1", "share of the run with the motor at its limit"),
    Channel("longest_saturation", ("joint",), "s", "longest time of the motor at its limit"),
    Channel(
        "reading_saturation", ("instrument",), "1", "share of the frames at the limit of readings"
    ),
    Channel(
        "longest_reading_saturation", ("instrument",), "s", "longest time of a reading at its limit"
    ),
    Channel("stop_depth", ("joint",), "rad", "largest motion beyond the stops, at the samples"),
    Channel(
        "stop_hits",
        ("joint",),
        "1",
        "number of impacts on the stops; with fixed steps or several joints, those at samples",
    ),
    Channel("contact_depth", ("contact",), "m", "largest depth in the surface, at the samples"),
    Channel("integration_error", (), "m", "error of the tip, estimated by a second run"),
)

#: Numbers of a whole run about its limits, by name.
LIMITS: dict[str, Channel] = {channel.name: channel for channel in _LIMITS}
#: Channels by name.
CHANNELS: dict[str, Channel] = {channel.name: channel for channel in _TABLE}
