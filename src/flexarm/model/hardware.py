"""Description of the instruments and motors between a controller and an arm."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, get_args

from pydantic import BeforeValidator, Field

from flexarm.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import (
    Count,
    Listed,
    NonNegative,
    Number,
    OneOrMany,
    Positive,
    Word,
    plain,
)
from flexarm.model.wording import Fault

ChannelSignal = Literal[
    "joint_angle",
    "joint_rate",
    "joint_twist",
    "link_angle",
    "link_rate",
    "link_tip_deflection",
    "link_tip_slope",
    "link_tip_deflection_rate",
    "link_tip_slope_rate",
    "tip",
    "tip_velocity",
    "tip_angle",
    "tip_angle_rate",
    "strain",
    "torque",
    "contact_force",
    "contact_gap",
]
PointSignal = Literal["position", "velocity", "acceleration"]
Signal = Literal[ChannelSignal, PointSignal]
#: Signals that are channels of results, and signals of a point of a link.
CHANNEL_SIGNALS: tuple[str, ...] = get_args(ChannelSignal)
POINT_SIGNALS: tuple[str, ...] = get_args(PointSignal)
#: Keys of motors that may have one value per joint.
LIMITS = ("torque_limit", "torque_constant", "current_limit", "voltage_limit", "resistance")
Seed = Annotated[int, Field(strict=True, ge=0), BeforeValidator(plain)]


class InstrumentSpec(Record):
    """One sensor, or one sensor for each joint, link or gauge."""

    signal: Signal = Field(
        description="Channel that it reads; or position, velocity, acceleration of a point."
    )
    link: Count | None = Field(
        default=None, description="Link of the point, counted from 1 at the base."
    )
    station: NonNegative | None = Field(
        default=None,
        description="Distance of the point from the link's root (m); its tip if left out.",
    )
    frame: Literal["world", "link"] = Field(
        default="world",
        description="Of an acceleration: world, or along and across the link with gravity (link).",
    )
    name: Word | None = Field(
        default=None, description="Name in the measurement; that of the signal where left out."
    )
    resolution: NonNegative = Field(
        default=0.0, description="Step that readings are rounded to, in the signal's unit."
    )
    noise: NonNegative = Field(default=0.0, description="Standard deviation of white noise.")
    bias: Number = Field(default=0.0, description="Constant error.")
    limit: Positive | None = Field(default=None, description="Largest reading, in both directions.")
    delay: NonNegative = Field(
        default=0.0, description="Time from a frame to when the controller knows it (s)."
    )
    sample_time: Positive | None = Field(
        default=None, description="Time between frames (s); the controller's where left out."
    )
    rate_cutoff: Positive | None = Field(
        default=None, description="Cutoff of the rate that it derives (Hz); none where left out."
    )
    rate_name: Word | None = Field(default=None, description="Name of that rate.")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("signal"):
            return
        point = given.signal in POINT_SIGNALS
        if point and given.absent("link"):
            yield Fault(("link",), f"is required for the signal {given.signal}")
        for name in () if point else ("link", "station"):
            if not given.absent(name):
                rule = f"is not supported for the signal {given.signal}"
                yield Fault((name,), rule)
        if given.has("frame") and given.frame == "link" and given.signal != "acceleration":
            yield Fault(("frame",), "be world, except for accelerations", "link")


class MotorsSpec(Record):
    """Motors between the requested torque and the joints; values include the gear."""

    torque_limit: OneOrMany[Positive] | None = Field(
        default=None, description="Largest torque, one for all joints or one each (N m)."
    )
    delay: NonNegative = Field(default=0.0, description="Time until a torque begins to act (s).")
    time_constant: NonNegative = Field(default=0.0, description="Lag of the current loop (s).")
    torque_constant: OneOrMany[Positive] | None = Field(
        default=None, description="Torque per current, N m/A."
    )
    current_limit: OneOrMany[Positive] | None = Field(
        default=None, description="Largest current, A."
    )
    voltage_limit: OneOrMany[Positive] | None = Field(default=None, description="Supply, V.")
    resistance: OneOrMany[Positive] | None = Field(
        default=None, description="Resistance of the winding, ohm."
    )

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        voltage = not given.absent("voltage_limit")
        if (voltage or not given.absent("current_limit")) and given.absent("torque_constant"):
            rule = "is required with current_limit or voltage_limit"
            yield Fault(("torque_constant",), rule)
        if voltage and given.absent("resistance"):
            yield Fault(("resistance",), "is required with voltage_limit")


class HardwareSpec(Record):
    """Instruments and motors; exact sensors and ideal motors by default."""

    instruments: Listed[InstrumentSpec] | None = Field(
        default=None, description="What the controller measures."
    )
    motors: MotorsSpec | None = Field(default=None, description="What limits and delays torques.")
    seed: Seed = Field(default=0, description="Seed of all noise.")

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        seen: set[str] = set()
        for k, item in enumerate(given.instruments if given.has("instruments") else ()):
            for name in names_of(item):
                if name in seen:
                    rule = f"repeats {name!r}, the name of another instrument"
                    yield Fault(("instruments", k, "name"), rule)
                seen.add(name)


def names_of(item: InstrumentSpec) -> Iterator[str]:
    """Yield the names of the readings of an instrument in a measurement."""
    name = item.name or item.signal
    yield name
    if item.rate_cutoff is not None:
        yield item.rate_name or ("joint_rate" if name == "joint_angle" else f"{name}_rate")


def hardware_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults between the hardware of a scenario and its arm and drive."""
    if not given.has("hardware", "arm"):
        return
    links = given.arm.links
    gauges = any(link.gauges for link in links)
    for k, item in enumerate(given.hardware.instruments or ()):
        place = ("hardware", "instruments", k)
        if item.signal == "strain" and not gauges:
            yield Fault((*place, "signal"), "is strain, but the arm has no gauges")
        if item.signal.startswith("contact_") and given.has("contacts") and not given.contacts:
            yield Fault((*place, "signal"), f"is {item.signal}, but there are no contacts")
        if item.link is not None and item.link > len(links):
            rule = f"be the number of a link, 1 to {len(links)}"
            yield Fault((*place, "link"), rule, shown(item.link))
        elif item.link is not None and item.station is not None:
            length = links[item.link - 1].length
            if item.station > length * (1.0 + 1e-9):
                rule = f"be at most {length:.9g}, the length of the link"
                yield Fault((*place, "station"), rule, shown(item.station))
