"""The benchmark of whole calls runs and prints its tables. Times are not checked."""

from __future__ import annotations

import re

from benchmarks import report, whole_call


def test_a_simulation_takes_longer_than_its_steps() -> None:
    found = whole_call.simulations(repeats=1, duration=0.1)
    assert len(found) == 7
    for _, steps, whole, beside in found:
        assert 0.0 < steps < whole
        assert 0.0 < beside < whole
    table = report.whole_table(found)
    assert re.search(r"\| torque samples, 100 per second \| \d.* \| \d.* \| \d.* \| 2 \|", table)


def test_single_calls_are_timed() -> None:
    table = report.calls_table(whole_call.microseconds(repeats=1, calls=1))
    assert re.search(r"\| `Arm.forward_dynamics` \| [\d.e+]+ \| 8 \|", table)
    assert re.search(r"\| `Arm.inverse_dynamics` \| [\d.e+]+ \|  \|", table)
