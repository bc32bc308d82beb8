"""Reasons of a proposal, in sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from flexarm.planning.proposals.assessment import Assessed
from flexarm.planning.proposals.candidates import Candidate
from flexarm.planning.proposals.requirements import Requirements

if TYPE_CHECKING:
    import xarray as xr

_ERRORS = {
    "hold": "RMS error of the tip",
    "point_to_point": "settled error and residual vibration of the tip",
    "track": "RMS error of the tip",
    "force": "RMS error of the force",
}


def reasons_of(
    needs: Requirements,
    candidates: Sequence[Candidate],
    found: Mapping[str, Assessed],
    table: xr.Dataset,
    chosen: str,
) -> tuple[str, ...]:
    """Return the sentences that explain a proposal."""
    worst = table["score"].max("plant", skipna=False)
    reason = next(one.reason for one in candidates if one.name == chosen)
    result = _result(needs, table["score"].sel(candidate=chosen))
    sentences = [f"{chosen} for the task {needs.task}: {result}. {reason}"]
    for name in found:
        if name != chosen:
            sentences.append(_other(needs, name, found[name], float(worst.sel(candidate=name))))
    sentences += [
        f"{one.name} could not be designed for this arm."
        for one in candidates
        if one.name not in found
    ]
    if found[chosen].stable:
        sentences.append(_margin(needs, found[chosen]))
    else:
        hint = "Reduce the uncertainty, or add sensors."
        sentences.insert(0, f"No candidate is stable on {_arms(needs)}. {hint}")
    return (*sentences, *_advice(needs))


def _result(needs: Requirements, score: xr.DataArray) -> str:
    """Return the error of the proposal on the simulated arms, or the arms on which it fails."""
    failed = score["plant"].values[np.isnan(score.values)]
    if failed.size:
        return f"it does not complete its run on {' and '.join(map(repr, map(str, failed)))}"
    return (
        f"{_ERRORS[needs.task]} at most {_amount(needs, float(score.max()))} on the simulated arms"
    )


def _other(needs: Requirements, name: str, one: Assessed, worst: float) -> str:
    """Return why another candidate is not proposed, or how near it is."""
    if not one.stable:
        return f"{name} is unstable on one of the arms."
    if not np.isfinite(worst):
        return f"{name} does not complete its run on one of the arms."
    text = f"{name}: {_amount(needs, worst)}"
    if one.margins["disk_margin"] < needs.disk_margin:
        text += f", with a disk margin of only {one.margins['disk_margin']:.2g}"
    return text + "."


def _margin(needs: Requirements, one: Assessed) -> str:
    """Return the margins of a stable proposal, in words."""
    margins = one.margins
    text = (
        f"On {_arms(needs)}, at the start and at the end of the motion, the loop of each joint "
        f"permits a gain factor of {margins['gain_margin']:.2g}, "
        f"{np.degrees(margins['phase_margin']):.0f} degrees of phase and "
        f"{1e3 * margins['delay_margin']:.2g} ms of delay (disk margin "
        f"{margins['disk_margin']:.2g}). The slowest vibration has a damping ratio of "
        f"{margins['damping_ratio']:.2g}."
    )
    if margins["disk_margin"] < needs.disk_margin:
        text += f" No candidate has the required disk margin of {needs.disk_margin:g}."
    return text


def _arms(needs: Requirements) -> str:
    """Return the arms on which loops are analysed, in words."""
    if needs.payload or needs.rigidity:
        return "all arms within the uncertainty that were tried"
    return "the model"


def _advice(needs: Requirements) -> Iterator[str]:
    """Yield what would permit better controllers."""
    free = needs.task != "force"
    if free and needs.computing == "low" and needs.lowest:
        yield (
            "With more computing power, an observer of the bending (LQG) is a candidate: "
            'computing="medium".'
        )
    if free and needs.lowest and not {"gauges", "tip"} & needs.sensors:
        yield "Strain gauges near the roots of the links would show the bending to the controller."
    if needs.computing == "high" and needs.torque_limit is None and free:
        yield "MPC is not a candidate without torque_limit."
    if needs.task == "track" and (needs.payload or needs.rigidity):
        yield "If the motion repeats, iterative learning removes the errors of an uncertain arm."
    if not (needs.payload or needs.rigidity):
        yield "The arm is taken as exact: give the uncertainty of its payload and rigidity."


def _amount(needs: Requirements, error: float) -> str:
    return f"{error:.3g} N" if needs.task == "force" else f"{1e3 * error:.3g} mm"
