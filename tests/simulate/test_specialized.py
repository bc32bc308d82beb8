"""When a run compiles for its own sizes: by the work that it has counted, never by the clock."""

import itertools

import pytest

import flexarm as fa
from flexarm.engine import stepping


@pytest.fixture
def compiled(monkeypatch):
    """Count the switches to compile-time sizes, and make none."""
    switches = []

    def count(constants):
        switches.append(constants)
        return stepping.run_time_sizes(constants)

    monkeypatch.setattr(stepping, "compile_time_sizes", count)
    return switches


def swing(duration):
    arm = fa.Arm(
        links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)], gravity=(0.0, -9.81)
    )
    return fa.simulate(arm, duration, rate=100.0)


def test_a_slow_machine_is_no_reason(compiled, monkeypatch):
    """Each look at the clock is an hour after the last, as on a machine that is busy."""
    hours = itertools.count(0.0, 3600.0)
    monkeypatch.setattr(stepping.time, "perf_counter", lambda: next(hours))
    result = swing(60.0)
    assert result.steps > 2 * 64  # several calls, after each of which it is decided
    assert compiled == []


def test_much_work_ahead_is_one(compiled, monkeypatch):
    monkeypatch.setattr(stepping, "_TRIED", 100.0)
    monkeypatch.setattr(stepping, "_WORTH_COMPILING", 100.0)
    swing(60.0)
    assert compiled


def test_a_short_rest_is_none(compiled, monkeypatch):
    monkeypatch.setattr(stepping, "_TRIED", 1000.0)
    swing(60.0)
    assert compiled == []
