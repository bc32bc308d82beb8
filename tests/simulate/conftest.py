"""Fixtures of several tests of runs."""

import pytest

from flexarm.simulation.batch import lanes


@pytest.fixture
def executed(monkeypatch):
    """Count the runs of batches that were executed in lanes."""
    count = []
    outcome = lanes.Lanes._outcome

    def counted(self, *arguments):
        found = outcome(self, *arguments)
        count.extend(found.runs)
        return found

    monkeypatch.setattr(lanes.Lanes, "_outcome", counted)
    return count
