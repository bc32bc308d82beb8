"""Functions with conditions, evaluated over CasADi symbols, against the same over numbers."""

import builtins

import casadi
import numpy as np
import pytest

from flexarm.bridges.symbolic.kernel_calls import SymbolError, objects, plain
from flexarm.bridges.symbolic.symbol_array import MOST_PATHS, branched, symbol_array


def one_condition(x, y):
    return x + y if x > y else x * y


def nested(x, y):
    if x > 0.0:
        return y if y > x else -y
    if not (y < -1.0 or x < -1.0):
        return 3.0
    return x * x


def guarded(x, y):
    if x <= 0.0:
        return y
    return np.sqrt(x) / x if y != 0.0 else 1.0 / x


def limited(x, y):
    return min(max(x, -0.5), 0.5) + max([y, 0.25, x]) + abs(y) + max((1, 2), key=abs)


def sides(x, y):
    return np.where(np.array([x, y]) == 0.0, 2.0, np.array([y, x])).sum()


FUNCTIONS = [one_condition, nested, guarded, limited, sides]
POINTS = [(a, b) for a in (-1.5, -0.5, 0.0, 0.3, 2.0) for b in (-1.5, -0.3, 0.0, 0.3, 2.5)]


def symbols():
    whole = casadi.SX.sym("x", 2)
    return whole, symbol_array(objects(casadi.vertsplit(whole), casadi))


def merged(function):
    """Return the merged function over symbols, and the number of its evaluations."""
    whole, entries = symbols()
    count = 0

    def evaluate():
        nonlocal count
        count += 1
        return {"value": casadi.vertcat(casadi.SX(plain(function(*entries))))}

    found = casadi.Function("f", [whole], [branched(evaluate)["value"]])
    return found, count


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda one: one.__name__)
def test_all_paths(function):
    found, _ = merged(function)
    for x, y in POINTS:
        value = float(found([x, y]))
        np.testing.assert_allclose(value, function(x, y), rtol=1e-15, atol=0, err_msg=f"{x}, {y}")


@pytest.mark.parametrize(
    ("function", "paths"), [(one_condition, 2), (nested, 5), (guarded, 3), (limited, 1)]
)
def test_number_of_paths(function, paths):
    assert merged(function)[1] == paths


def test_equal_conditions_have_one_value():
    def function(x, y):
        return sum((1.0 if x * y > 1.0 else 2.0) for _ in range(20))

    found, count = merged(function)
    # The product is a new expression each time, which a shallow comparison still recognises.
    assert count == 2
    assert float(found([2.0, 2.0])) == 20.0


def test_common_expressions_are_computed_once():
    def function(x, y):
        long = sum(np.sin(k * x) for k in range(1, 30))
        return long + (1.0 if y > 0.0 else 2.0)

    found, _ = merged(function)
    # The sum has three operations for each of its 29 terms, and each path has one number.
    assert found.n_instructions() < 2 * 3 * 29


def test_python_functions_are_restored():
    before = builtins.min, builtins.max
    merged(limited)
    with pytest.raises(ZeroDivisionError):
        merged(lambda x, y: 1 // 0)
    assert (builtins.min, builtins.max) == before


@pytest.mark.thorough
def test_too_many_paths():
    def function(x, y):
        return sum((1.0 if x > k else 0.0) for k in range(9))

    with pytest.raises(SymbolError, match=f"more than {MOST_PATHS} paths"):
        merged(function)


def test_results_of_other_sizes():
    whole, (x, _) = symbols()

    def evaluate():
        return {"value": whole if x > 0.0 else whole[0]}

    with pytest.raises(SymbolError, match="one side of a condition"):
        branched(evaluate)
