"""Energy and tip of long runs: the second table of the page "Accuracy".

The two-link arm of Table I with three modes a link and the second-order theory is let go under
gravity, 50 degrees off its rest: large swings for 100 s. Errors of the energy are relative to the
largest energy in motion and bending; those of the tip are its distance, at the end, from that of
``dormand_prince_8`` at ``rtol=1e-12``.

    python docs/performance/measure_energy.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

import flexarm as fa
from flexarm.integrate import GeneralizedAlpha

DURATION = 100.0
CASES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("`dormand_prince_8`, `rtol=1e-7`", {"rtol": 1e-7}),
    ("`dormand_prince_8`, `rtol=1e-9`", {"rtol": 1e-9, "atol": 1e-11}),
    ("`kennedy_carpenter_5`, `rtol=1e-7`", {"integrator": "kennedy_carpenter_5"}),
    ("`cowell_4`, 0.3 ms", {"integrator": "cowell_4", "step": 3e-4}),
    (
        "`generalized_alpha`, radius 1, 1 ms",
        {"integrator": GeneralizedAlpha(step=1e-3, spectral_radius=1.0)},
    ),
    ("`generalized_alpha`, radius 0.8, 1 ms", {"integrator": "generalized_alpha", "step": 1e-3}),
    ("`gauss_6`, 2 ms", {"integrator": "gauss_6", "step": 2e-3}),
    ("`gauss_6`, 1 ms", {"integrator": "gauss_6", "step": 1e-3}),
)


def swinging_arm() -> fa.Arm:
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 4, "modes": 3}
    links = [fa.Link(length=1.4142, **rod), fa.Link(length=1.0, **rod)]
    return fa.Arm(links=links, gravity=(0.0, -9.81), theory="second_order")


def run(duration: float, **setting: Any) -> xr.Dataset:
    arm = swinging_arm()
    return fa.simulate(arm, duration, initial=arm.rest([-0.7, 0.3]), rate=100.0, **setting)


def energy_error(result: xr.Dataset) -> Any:
    """Error of the energy at each sample, (samples,)."""
    moving = (result.kinetic_energy + result.strain_energy).values
    energy = moving + result.gravity_energy.values
    return (energy - energy[0]) / moving.max()


def tip_error(result: xr.Dataset, exact: xr.Dataset) -> float:
    """Distance of the tips (m) at the last sample."""
    return float(np.linalg.norm((result.tip - exact.tip).values[-1]))


if __name__ == "__main__":
    exact = run(DURATION, rtol=1e-12, atol=1e-14)
    print("| integrator | error by 10 s | by 100 s | tip at 100 s | evaluations |")
    print("| --- | --- | --- | --- | --- |")
    for name, setting in CASES:
        result = run(DURATION, **setting)
        error = np.abs(energy_error(result))
        early = error[result.time.values <= DURATION / 10].max()
        tip = tip_error(result, exact)
        count = result.attrs["evaluations"] / 1e6
        print(f"| {name} | {early:.0e} | {error.max():.0e} | {tip:.0e} m | {count:.1f} million |")
