"""Numbers of a report: peaks, errors from the reference, energies, work of the integrator."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from numbers import Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import shown
from flexarm.simulation.calls.metrics import METRICS, metrics_of, tip_reference
from flexarm.view.plot.selection import Signals

if TYPE_CHECKING:
    import xarray as xr

FloatArray = NDArray[np.float64]

#: Channels that are not in the table of extreme values.
_ENERGIES = ("kinetic_energy", "strain_energy", "gravity_energy", "contact_energy")


@dataclass(frozen=True)
class Table:
    """Table of numbers: title, headings, rows of text with the name first, notes by name."""

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: Mapping[str, str] = field(default_factory=dict)


def number(value: float) -> str:
    """Format a number with five digits; a dash stands for a missing one."""
    return f"{value + 0.0:.5g}" if np.isfinite(value) else "–"


def extremes_table(histories: Iterable[Signals]) -> Table:
    """Return the extreme and final values of histories, and the time of the largest magnitude."""
    rows = []
    for signals in histories:
        for label, values in zip(signals.labels, signals.values.T, strict=True):
            name = f"{signals.title}, {label}" if label else signals.title
            if not np.isfinite(values).any():
                continue
            peak = signals.time[np.nanargmax(np.abs(values))]
            found = (np.nanmin(values), np.nanmax(values), peak, values[-1])
            rows.append((f"{name} [{signals.unit}]", *(number(float(value)) for value in found)))
    heads = ("", "lowest", "highest", "peak at [s]", "at the end")
    return Table("Extreme values", heads, tuple(rows))


def errors_table(result: xr.Dataset, arm: Arm, reference: Any) -> Table:
    """Return the errors from the reference during and after the motion, and at the end."""
    values = metrics_of(result, arm, reference)
    rows, notes = [], {}
    for metric in METRICS:
        if np.isfinite(values[metric.name]) and metric.name != "controller_time":
            words = metric.name.replace("rms", "RMS").replace("_", " ")
            name = f"{words[0].upper()}{words[1:]} [{metric.unit}]"
            rows.append((name, number(values[metric.name])))
            notes[name] = metric.meaning
    rows.append(("Tip error at the end [m]", number(float(tip_error(arm, reference, result)[-1]))))
    desired = np.asarray(reference.joint_angle(float(result["time"].values[-1])))
    missed = result["joint_angle"].values[-1] - desired
    for joint, value in zip(arm.joint_numbers, missed, strict=True):
        rows.append((f"Joint {joint}: error at the end [rad]", number(float(value))))
    return Table("Errors from the reference", ("", "value"), tuple(rows), notes)


def tip_error(arm: Arm, reference: Any, result: xr.Dataset) -> FloatArray:
    """Return the distance of the tip from its reference (T,) m."""
    missed = result["tip"].values - tip_reference(arm, reference, result["time"].values)
    return np.asarray(np.hypot(*missed.T))


def energies(result: xr.Dataset) -> dict[str, FloatArray]:
    """Return the energies of a result over time (T,) J by name, and their sum; zero ones apart."""
    found = {}
    for name in _ENERGIES:
        if name in result:
            values = result[name].values
            values = values.reshape(len(values), -1).sum(axis=1)
            if np.any(values) or name == "kinetic_energy":
                found[name.removesuffix("_energy")] = values
    return found | {"sum": np.sum(list(found.values()), axis=0)}


def energies_table(result: xr.Dataset) -> Table:
    """Return the energies at the start, at their maximum and at the end."""
    rows = [
        (
            f"{name.capitalize()} [J]",
            *(number(float(value)) for value in (values[0], values.max(), values[-1])),
        )
        for name, values in energies(result).items()
    ]
    return Table("Energies", ("", "at the start", "highest", "at the end"), tuple(rows))


def worded(form: str, value: object) -> str:
    """Return a formatted attribute; its text if another program has replaced it by another kind."""
    try:
        return form.format(value)
    except (TypeError, ValueError):
        return shown(value)


def run_facts(result: xr.Dataset) -> list[tuple[str, str]]:
    """Return names and values that describe how a run was computed."""
    attributes, time = result.attrs, result["time"].values
    rows = [("time", f"{number(time[0])} to {number(time[-1])} s, {time.size} samples")]

    def add(name: str, key: str, form: str = "{}", unless: str = "") -> None:
        text = "" if attributes.get(key) is None else worded(form, attributes[key])
        if text not in ("", unless):
            rows.append((name, text))

    add("ended by", "ended_by")
    add("integrator", "integrator")
    add("its choice", "integrator_reason")
    if "rtol" in attributes and "atol" in attributes:
        relative, absolute = worded("{:g}", attributes["rtol"]), worded("{:g}", attributes["atol"])
        rows.append(("tolerances", f"{relative} relative, {absolute} m"))
    add("steps", "steps")
    for name in ("rejected_steps", "impact_steps"):
        add(name.replace("_", " "), name, unless="0")
    add("evaluations", "evaluations")
    add("computing time", "wall_seconds", "{:.3g} s")
    add("controller", "controller")
    add("its sample time", "sample_time", "{:g} s")
    calls, seconds = (attributes.get(f"controller_{name}") for name in ("calls", "seconds"))
    if isinstance(calls, Real) and isinstance(seconds, Real) and float(calls):
        mean = 1e6 * float(seconds) / float(calls)
        rows.append(("its computing time", f"{mean:.3g} µs for each of {calls} samples"))
    return rows


def key_figures(result: xr.Dataset, arm: Arm, reference: Any) -> list[tuple[str, str, str]]:
    """Return the main numbers of a run: name, value and unit."""
    found = []
    if "link_tip_deflection" in result:
        bent = np.abs(result["link_tip_deflection"].values)
        found.append(("peak tip deflection of a link", number(1e3 * float(bent.max())), "mm"))
    if reference is not None:
        end = float(tip_error(arm, reference, result)[-1])
        found.append(("tip error at the end", number(1e3 * end), "mm"))
    if "torque" in result and result["torque"].size:
        found.append(("peak torque", number(float(abs(result["torque"].values).max())), "N m"))
    if "kinetic_energy" in result:
        moving = float(result["kinetic_energy"].values.max())
        found.append(("peak kinetic energy", number(moving), "J"))
    if "evaluations" in result.attrs:
        count = worded("{:,}", result.attrs["evaluations"])
        found.append(("evaluations of the dynamics", count, ""))
    return found
