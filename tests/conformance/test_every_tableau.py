"""Coefficients of the Runge-Kutta methods: every order condition, and no typing error."""

import dataclasses

import numpy as np
import pytest
from rooted_trees import density, size, trees, weights

from flexarm.integrate import INTEGRATORS
from flexarm.integrate.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.tableau import Tableau, hermite_dense

METHODS = {n: kind for n, kind in INTEGRATORS.items() if issubclass(kind, ExplicitRungeKutta)}
every = pytest.mark.parametrize("name", METHODS)


def conditions(order):
    return [tree for nodes in range(1, order + 1) for tree in trees(nodes)]


def missed(A, b, tree):
    return b @ weights(tree, A) - 1.0 / density(tree)


def test_number_of_trees():
    """OEIS A000081."""
    assert [len(trees(nodes)) for nodes in range(1, 10)] == [1, 1, 2, 4, 9, 20, 48, 115, 286]
    assert all(size(tree) == 8 for tree in trees(8))
    assert len(conditions(8)) == 200


@every
def test_order_conditions_up_to_the_claimed_order(name):
    tableau = METHODS[name]().tableau
    s = tableau.stages
    A, b = tableau.A[:s, :s], tableau.b
    assert METHODS[name].order == tableau.order
    # Coefficients of 16 digits, as large as 40 in the method of order 8.
    worst = max(abs(missed(A, b, tree)) for tree in conditions(tableau.order))
    assert worst < 5e-14
    # And no further: the next order is not claimed because it is not there.
    assert max(abs(missed(A, b, tree)) for tree in trees(tableau.order + 1)) > 1e-7


@every
def test_dense_output_has_third_order_throughout_the_step(name):
    tableau = METHODS[name]().tableau
    powers = np.arange(1, tableau.dense.shape[1] + 1)
    for theta in (0.1, 0.37, 0.5, 0.8):
        b = tableau.dense @ theta**powers
        for tree in conditions(3):
            wanted = theta ** size(tree) / density(tree)
            assert b @ weights(tree, tableau.A) == pytest.approx(wanted, abs=1e-13)


@every
def test_error_estimates_vanish_only_up_to_their_order(name):
    """An estimate that sees nothing, or everything, controls nothing."""
    tableau = METHODS[name]().tableau
    if not METHODS[name].adaptive:
        assert np.all(tableau.error == 0.0)
        assert np.all(tableau.error_low == 0.0)
        return
    s = tableau.stages
    A = tableau.A[: s + 1, : s + 1]
    estimates = [tableau.error, tableau.error_low]
    for estimate in (e for e in estimates if np.any(e)):
        seen = [
            max(abs(estimate @ weights(tree, A)) for tree in trees(nodes))
            for nodes in range(1, tableau.order + 1)
        ]
        order = next(k for k, value in enumerate(seen) if value > 1e-6)
        assert 3 <= order < tableau.order  # trees of up to this many nodes are invisible
        assert max(seen[:order]) < 1e-13


@every
@pytest.mark.parametrize("field", ["A", "b", "c", "error", "error_low", "dense"])
def test_a_single_wrong_coefficient_cannot_be_constructed(name, field):
    tableau = METHODS[name]().tableau
    array = getattr(tableau, field)
    for place in zip(*np.nonzero(array), strict=True):
        wrong = array.copy()
        wrong[place] *= 1.0 + 1e-7  # the seventh digit
        with pytest.raises(ValueError, match="Tableau: "):
            dataclasses.replace(tableau, **{field: wrong})


@every
def test_a_coefficient_above_the_diagonal_cannot_be_constructed(name):
    tableau = METHODS[name]().tableau
    wrong = tableau.A.copy()
    wrong[0, 1], wrong[0, 2] = 1e-3, -1e-3
    with pytest.raises(ValueError, match="strictly lower triangular"):
        dataclasses.replace(tableau, A=wrong)


@every
def test_too_high_an_order_cannot_be_claimed(name):
    tableau = METHODS[name]().tableau
    with pytest.raises(ValueError, match="quadrature"):
        dataclasses.replace(tableau, order=2 * tableau.order)


def test_hermite_dense_output_of_euler_is_not_smooth_enough():
    """Values and slopes at both ends: what the helper promises is what the constructor checks."""
    b = np.array([0.5, 0.5])
    A = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.5, 0.0]])
    heun = Tableau(
        order=2,
        A=A,
        b=b,
        c=np.array([0.0, 1.0, 1.0]),
        error=np.zeros(3),
        error_low=np.zeros(3),
        dense=hermite_dense(b),
    )
    assert heun.stages == 2
    straight = np.zeros((3, 1))
    straight[:2, 0] = b
    with pytest.raises(ValueError, match="start with stage 0"):
        dataclasses.replace(heun, dense=straight)
