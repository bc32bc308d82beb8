"""Every benchmark runs once, small, so that it cannot rot. No time is judged here."""

from __future__ import annotations

import math
from pathlib import Path

from benchmarks import forward_dynamics, report, simulation, startup


def test_measures_and_writes_its_page(tmp_path: Path) -> None:
    comparison = forward_dynamics.compare(calls=10, repeats=1)
    links = forward_dynamics.scaling_in_links(counts=(2, 256), repeats=1)
    modes = forward_dynamics.scaling_in_modes(counts=(2, 8), repeats=1)
    points = simulation.work_precision(tolerances=(1e-4, 1e-6), duration=0.02, repeats=1)
    times = {"import": startup.import_seconds(repeats=1)}
    report.write(tmp_path, comparison, links, modes, points, times)

    page = (tmp_path / "index.md").read_text(encoding="utf-8")
    assert "| dormand_prince_8 | 1e-06 |" in page
    assert "| 256 |" in page
    for figure in ("scaling.png", "work-precision.png"):
        assert (tmp_path / figure).stat().st_size > 10_000, figure
    assert all(math.isfinite(value) and value > 0 for value in (*comparison, *links.values()))


def test_all_solvers_find_the_same_motion() -> None:
    """A benchmark of a wrong answer would be worth nothing: errors follow the tolerance."""
    points = simulation.work_precision(tolerances=(1e-5, 1e-7), duration=0.05, repeats=1)
    for point in points:
        # Accumulated over the run; the tip has moved by millimetres.
        assert point.error < 50 * point.tolerance * 1e-2, point
    ours = {p.tolerance: p.error for p in points if p.method == "dormand_prince_8"}
    assert ours[1e-7] < ours[1e-5]
