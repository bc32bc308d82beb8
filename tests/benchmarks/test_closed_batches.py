"""The benchmark of batches with controllers returns its table."""

import pytest

from benchmarks import closed_batches


@pytest.mark.thorough
def test_every_controller_has_a_row():
    found = closed_batches.closed_batches(runs=2, few=1, repeats=1)
    lines = closed_batches.table(found).splitlines()
    assert len(lines) == 2 + len(found) == 7
    assert all(one.single > 0.0 and one.batch > 0.0 for one in found)
    assert lines[2].startswith("| joint PD | ")
