"""Instants at which a one-sided spring begins or ceases to push."""

import math

import numpy as np
import pytest

from flexarm.integrate.memory import AHEAD, CLOCK_PLACES, RESUMED
from flexarm.integrate.switching import first_change, step_to_change
from flexarm.kernels.compilation.cache import compiled

NO_SLACK = 1e-15


@compiled
def changed(h, g0, r0, g1, r1, damping, pushing):
    return first_change(h, g0, r0, g1, r1, damping, pushing, NO_SLACK)


@compiled
def step(clock, h, g0, r0, g1, r1, pushing):
    return step_to_change(clock, h, h, 1.0, g0, r0, g1, r1, 0.0, pushing, NO_SLACK)


def ends(gap, rate, h):
    return gap(0.0), rate(0.0), gap(h), rate(h)


def test_a_parabola_crosses_where_it_is_zero():
    where = ends(lambda t: 0.5 - t - t * t, lambda t: -1.0 - 2.0 * t, 1.0)
    assert changed(1.0, *where, 0.0, False) == pytest.approx(
        0.5 * (math.sqrt(3.0) - 1.0), rel=1e-14
    )


def test_a_dip_between_two_ends_outside_is_found():
    where = ends(lambda t: (t - 0.3) * (t - 0.6), lambda t: 2.0 * t - 0.9, 1.0)
    assert changed(1.0, *where, 0.0, False) == pytest.approx(0.3, rel=1e-14)


def test_a_zero_at_the_start_is_no_change():
    """The step before ended there."""
    where = ends(lambda t: -t * (1.0 - 0.1 * t), lambda t: 0.2 * t - 1.0, 1.0)
    assert changed(1.0, *where, 0.0, True) == math.inf


def test_the_push_of_a_damped_spring_ends_before_the_gap_opens():
    """gap = -1 + 2 t^2, rate 4 t; 1 - damping 4 t is zero at 0.25."""
    where = ends(lambda t: 2.0 * t * t - 1.0, lambda t: 4.0 * t, 0.5)
    assert changed(0.5, *where, 1.0, True) == pytest.approx(0.25, rel=1e-12)
    assert changed(0.5, *where, 0.4, True) == math.inf


def test_rounding_errors_of_the_gap_are_no_change():
    assert changed(1.0, 1e-17, -1e-17, -1e-17, 1e-17, 0.0, False) == math.inf


def test_a_change_ahead_is_predicted_and_one_inside_remembers_the_step():
    clock = np.zeros(CLOCK_PLACES)
    assert step(clock, 1.0, 1.05, -1.0, 0.05, -1.0, False) == 1.0
    assert clock[AHEAD] == pytest.approx(0.05, rel=1e-6)
    assert step(clock, 1.0, 0.7, -1.0, -0.3, -1.0, False) == pytest.approx(0.7, abs=1e-7)
    assert clock[RESUMED] == 1.0


def test_a_gap_that_nearly_closes_halves_the_step():
    clock = np.zeros(CLOCK_PLACES)
    where = ends(lambda t: (t - 0.5) ** 2 + 1e-3, lambda t: 2.0 * t - 1.0, 1.0)
    assert step(clock, 1.0, *where, False) == 0.5
    where = ends(lambda t: (t - 0.5) ** 2 + 0.1, lambda t: 2.0 * t - 1.0, 1.0)
    assert step(clock, 1.0, *where, False) == 1.0
