"""Calls of functions of time: values, failures, and functions that return no value."""

import functools

import numpy as np
import pytest

import flexarm as fa
from flexarm.base.errors import Problem
from flexarm.base.user_functions import FunctionError, call, call_many


async def later(t):
    return t


def one_by_one(t):
    yield t


async def later_one_by_one(t):
    yield t


@pytest.mark.parametrize(
    ("function", "kind"),
    [
        (later, "an asynchronous function"),
        (lambda t: later(t), "an asynchronous function"),
        (functools.partial(later), "an asynchronous function"),
        (later_one_by_one, "an asynchronous function"),
        (one_by_one, "a generator"),
    ],
)
def test_functions_that_return_no_value_are_named(function, kind):
    with pytest.raises(fa.InputError, match=f"torque must be a function that .* got {kind}"):
        call("torque", function, 0.5)


def test_values_are_returned():
    assert call("torque", lambda t: [t], 0.5) == [0.5]


@pytest.mark.parametrize("kind", [list, np.array])
def test_rows_are_kept_although_the_function_overwrites_them(kind):
    row = kind([0.0, 0.0])

    def reused(t):
        row[0] = t
        return row

    rows = []
    call_many("torque", reused, [0.1, 0.2], rows)
    assert [value[0] for value in rows] == [0.1, 0.2]


def test_rows_before_a_failure_are_kept():
    rows = []
    with pytest.raises(FunctionError, match="torque failed with ZeroDivisionError") as raised:
        call_many("torque", lambda t: (1.0 / (0.3 - t),), [0.1, 0.2, 0.3, 0.4], rows)
    assert raised.value.time == 0.3
    assert len(rows) == 2


def test_errors_of_the_package_and_coroutines_pass_through_many_calls():
    def refusing(t):
        raise fa.InputError(Problem("given", "be positive"))

    with pytest.raises(fa.InputError, match="given be positive"):
        call_many("torque", refusing, [0.1], [])
    with pytest.raises(fa.InputError, match="torque must be a function that returns a value"):
        call_many("torque", one_by_one, [0.1], [])
