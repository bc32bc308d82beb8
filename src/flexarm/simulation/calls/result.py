"""Labelled dataset of a run."""

from __future__ import annotations

import platform
from collections.abc import Collection, Mapping
from functools import cache, lru_cache
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import once_per_arm, turning_joints
from flexarm.arm.observe import bristle_channel, channels_of, contact_channels
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    LargeDeflectionWarning,
    ModelError,
    Problem,
    warn_caller,
)
from flexarm.base.late import xr
from flexarm.base.references import package_version
from flexarm.integrate.base import FloatArray
from flexarm.kernels.compilation.cache import can_compile
from flexarm.kernels.recursion.closures import ROW_ANGLE, ROW_X, ROW_Y, ROWS
from flexarm.linear.statics.axial import closure_warning
from flexarm.model import arm_spec_of_text, file_text
from flexarm.simulation.run.channels import CHANNELS, SLIDING, Channel
from flexarm.simulation.run.stepping import Run, section_channels

if TYPE_CHECKING:
    from flexarm.simulation.loop.control_loop import ClosedLoop

#: Channels of contacts, and all channels that need more than states and torques.
BY_CONTACTS = {"contact_force", "contact_gap", "contact_energy"}
BY_FORCES = BY_CONTACTS | {
    *("joint_force", "joint_moment", "axial_force", "shear_force", "bending_moment"),
    "closure_force",
}


def channels_of_run(
    run: Run, given: FloatArray, names: Collection[str] | None = None
) -> dict[str, FloatArray]:
    """Compute the channels of a run, those in ``names`` at least, at the samples so far."""
    found = [_channels_of_span(part, given[samples], names) for samples, part in run.parts()]
    if len(found) == 1:
        return found[0]
    return {name: np.concatenate([one[name] for one in found]) for name in found[0]}


def _channels_of_span(
    run: Run, given: FloatArray, names: Collection[str] | None
) -> dict[str, FloatArray]:
    count = run.progress.sample
    times, states = run.sample_times[:count], run.samples[:count]
    if run.prescribed or run.arm.closure_rows or not BY_FORCES.isdisjoint(names or ()):
        names = None
    channels = channels_of(run.arm, states, names) | bristle_channel(run.arm, states)
    if names is not None:
        return channels | {"torque": given}
    motor, force, moment, inside, closing = run.reactions(times, channels["link_angle"], given)
    channels |= {"torque": motor, "joint_force": force, "joint_moment": moment}
    channels |= section_channels(inside)
    if run.arm.closure_rows:
        channels["closure_force"] = closing[:, :-1].copy()
        independence = closing[:, -1]
        nearest = int(np.argmin(independence))
        if independence[nearest] < _SINGULAR:
            near = np.sqrt(max(independence[nearest], 0.0))
            text = (
                f"the mechanism is about {near:.1g} rad from a singular posture at "
                f"t = {times[nearest]:.4g} s, where its closures depend on each other: beyond it, "
                "the motion may continue in another working mode, and forces near it are "
                "uncertain."
            )
            warn_caller(text, AccuracyWarning)
        if text := closure_warning(run.arm, closing[:, :-1]):
            warn_caller(text, LargeDeflectionWarning)
    return channels | contact_channels(run.arm, run.loads.placed.contacts, states)


#: Independence of closures below which a run is near a singular posture: about 0.01 rad.
_SINGULAR = 1e-4


#: The last results, with zeros as channels: the next arm often has the same links and channels.
_kept_labels: dict[tuple[object, ...], xr.Dataset] = {}
_MOST_LABELS = 16


@cache
def software_versions() -> str:
    """Return the versions of Python and the numerical packages, and the platform, as one line."""
    names = ["numpy", "scipy", "xarray", *(["numba"] if can_compile() else [])]
    packages = [f"{name} {version(name)}" for name in names]
    system = f"{platform.system()} {platform.machine()}"
    return ", ".join([f"Python {platform.python_version()}", *packages, system])


@once_per_arm
def arm_text(arm: Arm) -> str:
    """Return the text of an arm's file."""
    return file_text(arm.spec)


def arm_of(name: str, result: xr.Dataset) -> Arm:
    """Return the arm of a result, from its attribute ``arm``."""
    text = result.attrs.get("arm")
    if not isinstance(text, str):
        raise InputError(Problem(name, "has no attribute 'arm' with the text of its arm"))
    try:
        return _arm(text)
    except ModelError as error:
        rule = f"has an invalid attribute 'arm': {str(error.problems[0]).rstrip('.')}"
        raise InputError(Problem(name, rule)) from None


@lru_cache(maxsize=8)
def _arm(text: str) -> Arm:
    return Arm(arm_spec_of_text(text, "result"))


def make_result(
    arm: Arm, times: FloatArray, values: dict[str, FloatArray], attributes: dict[str, Any]
) -> xr.Dataset:
    """Create the labelled dataset of the samples of a run."""
    if "bending_moment" in values:  # not cached, because users may change `position`
        dataset = _labelled(arm, times, values)
    else:
        dataset = _with_values(_labels(arm, times, values), values)
    software = {"flexarm_version": package_version(), "software": software_versions()}
    dataset.attrs = {**software, **attributes, "arm": arm_text(arm)}
    return dataset


def _with_values(labels: xr.Dataset, values: dict[str, FloatArray]) -> xr.Dataset:
    """Return a dataset of its own with the labels, and with the values of its channels.

    ``Dataset.copy(data=values)`` copies and checks every variable several times, which takes a
    third of the fixed time of a call. Here the constructor without checks is used, as in xarray's
    own methods. Datasets share indexes, which nothing changes in place.
    """
    variables = {
        name: xr.Variable(variable.dims, values[name], variable.attrs, fastpath=True)
        if name in values
        else variable.copy(deep=False)
        for name, variable in labels.variables.items()
    }
    indexes, sizes = dict(labels.xindexes), dict(labels.sizes)
    try:
        return xr.Dataset._construct_direct(variables, set(indexes), sizes, indexes=indexes)
    except (AttributeError, TypeError):  # another version of xarray
        coordinates = {name: variables.pop(name) for name in indexes}
        return xr.Dataset(variables, coords=coordinates)


def _labels(arm: Arm, times: FloatArray, values: dict[str, FloatArray]) -> xr.Dataset:
    """Return a dataset with the labels of a result: an earlier one with the same, or a new one."""
    shapes = {name: array.shape for name, array in values.items()}
    key = _names_of(arm), times.tobytes(), *shapes.items()
    labels = _kept_labels.get(key)
    if labels is None:
        times = times.copy()
        times.setflags(write=False)  # results share the time index
        nothing = {name: np.broadcast_to(0.0, shape) for name, shape in shapes.items()}
        labels = _kept_labels[key] = _labelled(arm, times, nothing)
        for oldest in list(_kept_labels)[:-_MOST_LABELS]:
            _kept_labels.pop(oldest, None)  # another thread may have removed it
    return labels


@once_per_arm
def _names_of(arm: Arm) -> tuple[object, ...]:
    """Return what determines the labels of the results of an arm with some channels."""
    numbers = tuple(arm.joint_numbers.tolist())
    names = (*_coordinate_names(arm), *turning_joints(arm).tolist())
    return names, numbers, arm.n_links, _gauge_names(arm), _closure_names(arm)


def _labelled(arm: Arm, times: FloatArray, values: dict[str, FloatArray]) -> xr.Dataset:
    """Label the values of channels at times (samples,)."""
    variables = {
        name: (("time", *CHANNELS[name].dims), array, channel_labels(arm, CHANNELS[name]))
        for name, array in values.items()
    }
    stations = values["bending_moment"].shape[-1] if "bending_moment" in values else 0
    contacts = values["contact_gap"].shape[1] if "contact_gap" in values else 0
    coordinates = coordinates_of(arm, times, stations, contacts)
    return xr.Dataset(variables, coords=coordinates)


def add_loop(dataset: xr.Dataset, loop: ClosedLoop, growth: float) -> xr.Dataset:
    """Add the attributes of the controller, its commands, and the readings of its hardware.

    ``growth`` is the largest real part (1/s) of the poles of the loop; NaN if it is not analysed.
    """
    if np.isfinite(growth):
        dataset.attrs["loop_growth"] = growth
    dataset.attrs["controller"] = type(loop.controller).__name__
    dataset.attrs["sample_time"] = float(loop.controller.sample_time)
    dataset.attrs["controller_calls"] = len(loop.times)
    dataset.attrs["controller_seconds"] = loop.seconds
    dataset.attrs |= loop.report()
    if "torque_command" not in dataset.variables:
        command = loop.command_at(dataset["time"].values)
        labels = channel_labels(loop.run.arm, CHANNELS["torque_command"])
        dataset["torque_command"] = (("time", "joint"), command, labels)
    if loop.hardware is None:
        return dataset
    return add_readings(dataset, np.asarray(loop.times), loop.readings())


def exceeded_bound(report: Mapping[str, Any]) -> str:
    """Return the warning of a loop that left its prescribed bound, or empty text."""
    if not report.get("bound_exceeded", 0):
        return ""
    first = report["bound_first_ratio"]
    if first > 1.0:
        return (
            f"the first angle error is {first:.3g} times its bound, and the bounds hold only if it "
            "is within: raise start_bound, or start nearer to the reference."
        )
    return (
        f"the angle error was outside its bound at {report['bound_exceeded']} samples: raise the "
        "bound, rate_bound or gain_limit, or shorten sample_time."
    )


def add_readings(
    dataset: xr.Dataset, times: FloatArray, readings: Mapping[str, FloatArray]
) -> xr.Dataset:
    """Add a channel ``measured_NAME`` (tick, ...) for each reading at sample times (ticks,), s."""
    ticks = ("tick", times, {"units": "s", "long_name": "sample time of the controller"})
    for name, values in readings.items():
        reading = f"measured_{name}"
        meaning = {"long_name": f"{name} as measured"}
        # Most readings are rows of numbers; a contact force has one more axis.
        parts = [f"{reading}_part", f"{reading}_axis"][: values.ndim - 1]
        dataset[reading] = (("tick", *parts), values[: len(times)], meaning)
    return dataset.assign_coords(tick_time=ticks)


def channel_labels(arm: Arm, channel: Channel) -> dict[str, str]:
    """Return the attributes of a channel of an arm, which may have joints that slide."""
    name, unit, turning = channel.name, channel.unit, turning_joints(arm)
    labels = dict[str, str]()
    if "joint" in channel.dims and unit in SLIDING and not turning.all():
        if turning.any():
            labels["slides"] = " ".join(map(str, arm.joint_numbers[~turning]))
        unit = f"{unit} or {SLIDING[unit]}" if turning.any() else SLIDING[unit]
    elif name in ("q", "qd") and arm.assembly.constants.slides.any():
        unit = unit.replace(" or ", ", m or " if name == "q" else ", m/s or ")
    return {"units": unit, "long_name": channel.meaning} | labels


def coordinates_of(
    arm: Arm, times: FloatArray, stations: int = 0, contacts: int = 0
) -> dict[str, Any]:
    """Return the coordinates of a result at ``times`` (samples,), s, with their labels."""
    coordinates: dict[str, Any] = {
        "time": ("time", times, {"units": "s", "long_name": "time"}),
        "joint": ("joint", arm.joint_numbers, {"long_name": "joint, numbered as its link"}),
        "link": (
            "link",
            np.arange(1, arm.n_links + 1),
            {"long_name": "link, counted from the base"},
        ),
        "axis": ("axis", ["x", "y"], {"long_name": "world axis"}),
    }
    names = list(_coordinate_names(arm))
    coordinates["coordinate"] = "coordinate", names, {"long_name": "generalised coordinate"}
    if arm.assembly.base:
        meaning = "coordinate of the base"
        coordinates["direction"] = ("direction", ["x", "y", "angle"], {"long_name": meaning})
    if arm.closure_rows:
        meaning = "closure, counted as given, and direction of its force"
        coordinates["closure"] = ("closure", list(_closure_names(arm)), {"long_name": meaning})
    if arm.gauges:
        coordinates["gauge"] = ("gauge", list(_gauge_names(arm)), {"long_name": "strain gauge"})
    if stations:
        coordinates |= _stations(arm, stations)
    if contacts:
        numbers = np.arange(1, contacts + 1)
        meaning = "contact, counted as given"
        coordinates["contact"] = ("contact", numbers, {"long_name": meaning})
    return coordinates


def _coordinate_names(arm: Arm) -> tuple[str, ...]:
    names = [""] * arm.dof
    for coordinate in arm.assembly.base:
        names[coordinate.place] = f"base_{coordinate.name}"
    for seat in arm.assembly.seats:
        names[seat.angle] = f"joint_{seat.link + 1}"
        if seat.twist is not None:
            names[seat.twist] = f"joint_{seat.link + 1}_twist"
    for piece in arm.assembly.pieces:
        label = f"link_{piece.link + 1}"
        if len(arm.assembly.pieces_of(piece.link)) > 1:
            label += f"_segment_{piece.body - arm.assembly.link_body[piece.link] + 1}"
        for mode, place in enumerate(range(arm.dof)[piece.modal], start=1):
            names[place] = f"{label}_mode_{mode}"
    return tuple(names)


def _closure_names(arm: Arm) -> tuple[str, ...]:
    """Return a name for each row of the closures."""
    directions = {ROW_X: "x", ROW_Y: "y", ROW_ANGLE: "moment"}  # others have a normal
    rows = [row for closure in arm.spec.closures for row in ROWS[closure.kind]]
    numbers = zip(arm.closure_numbers, rows, strict=True)
    return tuple(f"{number} {directions.get(row, 'normal')}" for number, row in numbers)


def _gauge_names(arm: Arm) -> tuple[str, ...]:
    return tuple(f"link {link + 1} at {station:g} m" for link, station, _ in arm.gauges)


def _stations(arm: Arm, count: int) -> dict[str, Any]:
    """Return the coordinates of section forces: fraction of the link, and position in metres."""
    fraction = np.linspace(0.0, 1.0, count)
    position = arm.lengths[:, None] * fraction
    meaning = "place on the link, as a fraction of its length"
    distance = {"units": "m", "long_name": "distance from the root of the link"}
    return {
        "station": ("station", fraction, {"units": "1", "long_name": meaning}),
        "position": (("link", "station"), position, distance),
    }
