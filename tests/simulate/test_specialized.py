"""A run compiles kernels for its sizes depending on its counted work, never on the clock."""

import itertools
import time

import numpy as np
import pytest

import flexarm as fa
from flexarm.kernels.layout import run_time_sizes
from flexarm.simulation.run import stepping


@pytest.fixture
def compiled(monkeypatch):
    """Count the switches to compile-time sizes without compiling."""
    switches = []

    def count(constants):
        switches.append(constants)
        return run_time_sizes(constants)

    monkeypatch.setattr(stepping, "compile_time_sizes", count)
    return switches


def swing(duration):
    arm = fa.Arm(
        links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)], gravity=(0.0, -9.81)
    )
    return fa.simulate(arm, duration, rate=100.0)


def test_the_clock_decides_nothing(compiled, monkeypatch):
    """Each reading of the clock is an hour after the last one."""
    expected = swing(60.0)
    hours = itertools.count(0.0, 3600.0)
    monkeypatch.setattr(time, "perf_counter", lambda: next(hours))
    result = swing(60.0)
    assert result.steps > 2 * 64  # several calls, with a decision after each of them
    assert compiled == []
    np.testing.assert_array_equal(result.q, expected.q)
    assert result.evaluations == expected.evaluations


def test_much_remaining_work_causes_compilation(compiled, monkeypatch):
    monkeypatch.setattr(stepping, "_TRIED", 100.0)
    monkeypatch.setattr(stepping, "_WORTH_COMPILING", 100.0)
    swing(60.0)
    assert compiled


def test_little_remaining_work_causes_no_compilation(compiled, monkeypatch):
    monkeypatch.setattr(stepping, "_TRIED", 1000.0)
    swing(60.0)
    assert compiled == []


def test_specialized_without_numba_says_so(monkeypatch):
    monkeypatch.setattr(stepping, "can_compile", lambda: False)
    monkeypatch.setattr(stepping, "INTERPRETED", False)
    arm = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)])
    with pytest.raises(fa.InputError) as raised:
        fa.simulate(arm, 0.01, specialized=True)
    assert str(raised.value) == (
        "simulate: specialized needs Numba, which is not installed. pip install 'flexarm[jit]' "
        "brings it; without specialized, no run needs it."
    )
