"""The benchmark of whole calls runs, small, and prints its tables. No time is judged here."""

from __future__ import annotations

import re

from benchmarks import report, whole_call


def test_simulations_are_timed_beside_their_steps() -> None:
    found = whole_call.simulations(repeats=1, duration=0.1)
    assert len(found) == 3
    for _, steps, whole, beside in found:
        assert 0.0 < steps < whole
        assert 0.0 < beside < whole
    table = report.whole_table(found)
    assert re.search(r"\| torque samples, 100 per second \| \d.* \| \d.* \| \d.* \| 2 \|", table)


def test_single_calls_are_timed() -> None:
    table = report.calls_table(whole_call.microseconds(repeats=1, calls=1))
    assert re.search(r"\| `Arm.forward_dynamics` \| [\d.e+]+ \| 8 \|", table)
    assert re.search(r"\| `Arm.inverse_dynamics` \| [\d.e+]+ \|  \|", table)
