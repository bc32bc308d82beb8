"""Mesh refinement of the second-order theory: the table of the page "Accuracy".

The arm of the paper's Table I with all modes of 1 to 64 elements a link, over two seconds, against
geometrically exact beams (tests/data/tableI_exact.csv). The finest meshes take minutes.

    python docs/performance/measure_mesh.py
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import flexarm as fa

EXACT = Path(__file__).parents[2] / "tests" / "data" / "tableI_exact.csv"
ELEMENTS = (1, 2, 4, 8, 16, 32, 64)


def torque(t: float) -> np.ndarray:
    return np.array([4.0, 1.5]) * np.sin(2.0 * np.pi * t) if t <= 1.0 else np.zeros(2)


def row(elements: int, **settings: object) -> tuple[str, str, str]:
    """Return elements and modes a link and the largest tip error (m) of one run to 2 s."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": elements}
    arm = fa.Arm(
        links=[fa.Link(length=1.4142, **rod), fa.Link(length=1.0, **rod)], theory="second_order"
    )
    start = arm.rest([np.pi / 4, -np.pi / 2])
    try:
        result = fa.simulate(arm, 2.0, torque=torque, initial=start, rate=100, **settings)
    except fa.SimulationError as error:
        return str(elements), str(2 * elements), f"stops at {error.time:.2f} s"
    tip = np.loadtxt(EXACT, delimiter=",", skiprows=1)[:, 3:5]
    error = np.linalg.norm(result.tip.values - tip, axis=1).max()
    return str(elements), str(2 * elements), f"{error:.1e}"


if __name__ == "__main__":
    print("| elements a link | modes a link | largest tip error, m |")
    print("| --- | --- | --- |")
    for elements in ELEMENTS:
        print(f"| {' | '.join(row(elements))} |", flush=True)
