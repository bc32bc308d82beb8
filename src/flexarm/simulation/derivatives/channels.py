"""Derivatives of the channels of a run, from its samples in dual numbers."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.observe import Observed, named_channels, with_energies
from flexarm.arm.stations import place_gauges
from flexarm.integrate.base import FloatArray
from flexarm.kernels.compilation.duals import DualArray, Duals
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.layout import run_time_sizes
from flexarm.kernels.observation.observables import POSE_COLUMNS, observe_many, poses_many
from flexarm.kernels.observation.shapes import gauge_strains
from flexarm.simulation.derivatives.dual_run import DualRun

#: Samples whose poses are computed together, which bounds the scratch memory of long runs.
_CHUNK = 1024
#: Channels that are not linear in the states and the observed quantities.
_NONLINEAR = {
    *("link_tip_deflection", "link_tip_slope", "link_tip_deflection_rate", "link_tip_slope_rate"),
}


def channel_derivatives(
    arm: Arm, run: DualRun, count: int, names: Collection[str]
) -> list[dict[str, FloatArray]]:
    """Return the derivatives of channels (samples, ...) in each of ``count`` directions.

    The kernels compute poses and strains in dual numbers.
    """
    samples = run.samples.array
    parts: list[list[dict[str, FloatArray]]] = [[] for _ in range(count)]
    for first in range(0, len(samples), _CHUNK):
        states = Duals(samples[first : first + _CHUNK])
        observed = _observed(arm, run, states, with_energies(names))
        for place, found in enumerate(parts):
            found.append(_in_direction(arm, [states, *observed], place, names))
    return [
        {name: np.concatenate([part[name] for part in found]) for name in names} for found in parts
    ]


def _in_direction(
    arm: Arm, quantities: Sequence[DualArray | None], place: int, names: Collection[str]
) -> dict[str, FloatArray]:
    """Return the derivatives of channels in one direction.

    Args:
        quantities: states, and the fields of ``Observed`` that follow from them.
    """

    def channels(form: Callable[[Duals, int], FloatArray], own: set[str]) -> dict[str, FloatArray]:
        if not own:
            return {}
        found: list[Any] = [None if part is None else form(part, place) for part in quantities]
        return named_channels(arm, found[0], Observed(*found[1:]), own)

    linear = channels(_slopes, set(names) - _NONLINEAR)
    other = channels(_complex, _NONLINEAR.intersection(names))
    return linear | {name: array.imag / STEP for name, array in other.items()}


def _observed(
    arm: Arm, run: DualRun, states: DualArray, energies: bool
) -> tuple[DualArray, DualArray, DualArray, DualArray | None]:
    """Return poses, tips, energies and strains of states (samples, 2, n, 1 + m).

    Without ``energies``, they are zero.
    """
    count, sizes = states.shape[0], run_time_sizes(arm.assembly.run_constants)
    poses: DualArray = Duals.zeros(count, arm.assembly.bodies, POSE_COLUMNS)
    tips: DualArray = Duals.zeros(count, 6)
    energy: DualArray = Duals.zeros(count, 3)
    if energies:
        observe_many(sizes, run.constants, states, poses, tips, energy)
    else:
        poses_many(sizes, run.constants, states, poses, tips)
    strains: DualArray = None
    if arm.gauges:
        strains = Duals.zeros(count, len(arm.gauges))
        bodies = place_gauges(arm, arm.gauges)[1]
        gauge_strains(sizes, states, bodies, run.gauges, strains)
    return poses, tips, energy, strains


def _slopes(duals: Duals, place: int) -> FloatArray:
    """Return the derivatives in one direction."""
    slopes: FloatArray = duals.array[..., 1 + place]
    return slopes


def _complex(duals: Duals, place: int) -> FloatArray:
    """Return values that are perturbed in one direction by an imaginary step."""
    perturbed: FloatArray = duals.value + 1j * STEP * duals.array[..., 1 + place]
    return perturbed
