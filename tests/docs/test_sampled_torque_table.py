"""The table of zero-order-hold torques: rows of the page, and a few runs of its script."""

from __future__ import annotations

import itertools

import pytest
from reference_tables import table_rows

from page_scripts import script

#: Numbers of random arms whose three runs take a tenth of a second.
SEEDS = (3, 6, 12, 14)


@pytest.fixture(scope="module")
def module():
    return script("measure_sampled_torque")


@pytest.fixture(scope="module")
def rows():
    """Return cells: range, runs, errors of both methods, ratio of the evaluations."""
    return table_rows("docs/performance/accuracy.md", "held")


def test_page_has_a_row_for_each_range(module, rows):
    pairs = itertools.pairwise(module.ANGLES)
    assert [row[0] for row in rows] == [f"{low:g} to {high:g} rad" for low, high in pairs]


def test_page_supports_the_choice(rows):
    """Up to 0.3 rad the implicit method is better, beyond that it is worse in both columns."""
    for row in rows[:2]:
        assert float(row[4]) < 0.75
        assert max(map(float, row[2:4])) < 1e-8
    for row in rows[2:]:
        assert float(row[4]) > 1.0
        assert float(row[3]) > 100.0 * float(row[2])


def test_script_compares_both_methods(module, rows):
    found = [one for seed in SEEDS if (one := module.compare(seed, 2000.0))]
    assert found
    for one in found:
        assert 0.0 < one.angle < module.ANGLES[-1]
        assert min(one.evaluations) > 0
        # A thousand samples in half a second: at least one step for each.
        assert max(one.errors) < 1e-3
