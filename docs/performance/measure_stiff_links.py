"""Steps for a link that is almost rigid and falls for one second, by its rigidity.

python docs/performance/measure_stiff_links.py
"""

from __future__ import annotations

import numpy as np
import xarray as xr

import flexarm as fa

RIGIDITIES = (1e2, 1e4, 1e6, 1e8, 1e10)
#: Rigidity (N m^2) above which the explicit method takes too long to be shown.
LONGEST = 1e6


def fall(arm: fa.Arm, integrator: str) -> xr.Dataset:
    """Return the fall from the horizontal."""
    start = arm.rest([0.0])
    return fa.simulate(arm, 1.0, initial=start, rate=100.0, integrator=integrator, progress=False)


def row(rigidity: float) -> str:
    """Return the line of the table for one rigidity."""
    link = fa.Link(length=1.0, flexural_rigidity=rigidity, mass_per_length=1.0)
    arm = fa.Arm(links=[link], gravity=(0.0, -9.81))
    rigid = fa.simulate(arm.rigid(), 1.0, rate=100.0, rtol=1e-11, atol=1e-13)
    explicit = f"{fall(arm, 'dormand_prince_8').steps}" if rigidity <= LONGEST else "-"
    implicit, chosen = fall(arm, "kennedy_carpenter_5"), fall(arm, "auto")
    apart = np.linalg.norm((chosen.tip - rigid.tip).values, axis=1).max()
    return (
        f"| {rigidity:.0e} | {explicit} | {implicit.steps} | `{chosen.integrator}` | {apart:.0e} |"
    )


def table() -> str:
    """Return the table of all rigidities."""
    names = '`dormand_prince_8` | `kennedy_carpenter_5` | `"auto"` selects'
    head = f"| rigidity (N m^2) | {names} | difference (m) |"
    return "\n".join([head, "| --- | --- | --- | --- | --- |", *map(row, RIGIDITIES)])


if __name__ == "__main__":
    print(table())
