"""Calls of functions of time: values, failures, and functions that return no value."""

import functools

import pytest

import flexarm as fa
from flexarm.base.user_functions import call


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
