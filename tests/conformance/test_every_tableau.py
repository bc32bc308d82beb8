"""Coefficients of the Runge-Kutta methods: every order condition, and errors in single digits."""

import dataclasses
import itertools

import numpy as np
import pytest

from flexarm.integrate import INTEGRATORS
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive, AdditiveTableau
from flexarm.integrate.implicit.gauss import gauss_coefficients
from flexarm.integrate.implicit.kennedy_carpenter import ORDER_4
from flexarm.integrate.multistep import cowell_formulas
from flexarm.integrate.multistep.cowell_formulas import check_formula
from flexarm.integrate.order_conditions import (
    density,
    elementary_weights,
    largest_miss,
    size,
    trees,
)
from flexarm.integrate.tableau import Tableau, demand_order, hermite_dense

METHODS = {n: kind for n, kind in INTEGRATORS.items() if issubclass(kind, ExplicitRungeKutta)}
every = pytest.mark.parametrize("name", METHODS)
PAIRS = {n: kind.tableau for n, kind in INTEGRATORS.items() if issubclass(kind, Additive)}
PAIRS["start of cowell_4"] = ORDER_4
every_pair = pytest.mark.parametrize("name", PAIRS)


def conditions(order):
    return [tree for nodes in range(1, order + 1) for tree in trees(nodes)]


def test_number_of_trees():
    """OEIS A000081; with edges of two methods A000151."""
    assert [len(trees(nodes)) for nodes in range(1, 10)] == [1, 1, 2, 4, 9, 20, 48, 115, 286]
    assert [len(trees(nodes, 2)) for nodes in range(1, 7)] == [1, 2, 7, 26, 107, 458]
    assert all(size(tree) == 8 for tree in trees(8))
    assert len(conditions(8)) == 200


def test_density_of_chains_and_bushes():
    """It is n! for a chain, and n for a bush, whose condition is that of a quadrature."""
    chain, bush = (), ()
    for nodes in range(2, 8):
        chain, bush = ((0, chain),), ((0, ()), *bush)
        assert chain in trees(nodes)
        assert bush in trees(nodes)
        assert density(chain) == np.prod(np.arange(1, nodes + 1))
        assert density(bush) == nodes
    c = np.array([0.0, 0.3, 0.9])
    A = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.4, 0.5, 0.0]])
    np.testing.assert_allclose(elementary_weights(bush, A), c**6)


@every
def test_order_conditions_up_to_the_claimed_order(name):
    tableau = METHODS[name]().tableau
    s = tableau.stages
    A, b = tableau.A[:s, :s], tableau.b
    assert METHODS[name].order == tableau.order
    # Coefficients have 16 digits; the largest of the method of order 8 is 40.
    assert largest_miss(tableau.order, b, A)[0] < 5e-14
    # The conditions of the next order do not hold.
    assert largest_miss(tableau.order + 1, b, A)[0] > 1e-7


@every
def test_dense_output_has_third_order_throughout_the_step(name):
    tableau = METHODS[name]().tableau
    powers = np.arange(1, tableau.dense.shape[1] + 1)
    for theta in (0.1, 0.37, 0.5, 0.8):
        b = tableau.dense @ theta**powers
        for tree in conditions(3):
            wanted = theta ** size(tree) / density(tree)
            assert b @ elementary_weights(tree, tableau.A) == pytest.approx(wanted, abs=1e-13)


@every
def test_error_estimates_vanish_up_to_their_order_only(name):
    """An estimate that is always zero, or never, cannot control the step."""
    tableau = METHODS[name]().tableau
    if not METHODS[name].adaptive:
        assert np.all(tableau.error == 0.0)
        return
    s = tableau.stages
    A = tableau.A[: s + 1, : s + 1]
    for estimate, order in zip(tableau.error, tableau.error_orders, strict=True):
        assert 3 <= order < tableau.order
        assert largest_miss(order, estimate, A, exact=0.0)[0] < 1e-13
        assert largest_miss(order + 1, estimate, A, exact=0.0)[0] > 1e-6


@pytest.mark.parametrize(
    ("name", "field"),
    [
        *itertools.product(METHODS, ["A", "b", "c", "error", "dense"]),
        *itertools.product(PAIRS, ["explicit", "implicit", "c", "error"]),
    ],
)
def test_a_single_wrong_coefficient_cannot_be_constructed(name, field):
    tableau = METHODS[name]().tableau if name in METHODS else PAIRS[name]
    array = getattr(tableau, field)
    for place in zip(*np.nonzero(array), strict=True):
        wrong = array.copy()
        wrong[place] *= 1.0 + 1e-7  # the seventh digit
        with pytest.raises(ValueError, match="Tableau: "):
            dataclasses.replace(tableau, **{field: wrong})


@pytest.mark.parametrize(
    ("name", "field", "row", "columns"),
    [
        *((name, "A", 2, (0, 1)) for name in METHODS),
        *((name, field, 4, (0, 2)) for name in PAIRS for field in ("explicit", "implicit")),
    ],
)
def test_rows_with_wrong_order_conditions_are_rejected(name, field, row, columns):
    """Two errors that cancel in the sum of a row leave abscissae and quadrature unchanged."""
    tableau = METHODS[name]().tableau if name in METHODS else PAIRS[name]
    wrong = getattr(tableau, field).copy()
    wrong[row, columns] += [1e-7, -1e-7]
    with pytest.raises(ValueError, match="the new point misses an order condition of a tree of"):
        dataclasses.replace(tableau, **{field: wrong})


@every
def test_a_coefficient_above_the_diagonal_cannot_be_constructed(name):
    tableau = METHODS[name]().tableau
    wrong = tableau.A.copy()
    wrong[0, 1], wrong[0, 2] = 1e-3, -1e-3
    with pytest.raises(ValueError, match="strictly lower triangular"):
        dataclasses.replace(tableau, A=wrong)


@every
def test_too_high_an_order_is_rejected(name):
    tableau = METHODS[name]().tableau
    with pytest.raises(ValueError, match="misses an order condition"):
        dataclasses.replace(tableau, order=tableau.order + 1)


def test_hermite_dense_output_of_euler_is_rejected_as_not_smooth():
    """The constructor checks values and slopes at both ends."""
    b = np.array([0.5, 0.5])
    A = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.5, 0.0]])
    heun = Tableau(
        order=2,
        A=A,
        b=b,
        c=np.array([0.0, 1.0, 1.0]),
        error=np.zeros((2, 3)),
        error_orders=(0, 0),
        dense=hermite_dense(b),
    )
    assert heun.stages == 2
    straight = np.zeros((3, 1))
    straight[:2, 0] = b
    with pytest.raises(ValueError, match="start with stage 0"):
        dataclasses.replace(heun, dense=straight)


# Additive pairs ----------------------------------------------------------------------------------


def halves(tableau):
    s = tableau.explicit.shape[1]
    return tableau.explicit[:s], tableau.implicit[:s]


@every_pair
def test_coupled_order_conditions_up_to_the_claimed_order(name):
    """For every split of the equations, which means all trees with edges of both methods."""
    tableau, both = PAIRS[name], halves(PAIRS[name])
    b, estimate = tableau.implicit[-1], tableau.error[0, :-1]
    order = tableau.order
    # The paper prints fractions that are exact to about 25 digits.
    assert largest_miss(order, b, *both)[0] < 1e-14
    assert largest_miss(order - 1, estimate, *both, exact=0.0)[0] < 1e-14
    # The conditions of the next order do not hold, in either half.
    for A in both:
        assert largest_miss(order + 1, b, A)[0] > 1e-5
        assert largest_miss(order, estimate, A, exact=0.0)[0] > 1e-5


def test_pair_with_two_values_on_the_diagonal_is_rejected():
    tableau = PAIRS["kennedy_carpenter_5"]
    wrong = tableau.implicit.copy()
    wrong[2, 2] += 1e-3
    wrong[2, 0] -= 1e-3
    with pytest.raises(ValueError, match="one number on the diagonal"):
        AdditiveTableau(tableau.order, tableau.explicit, wrong, tableau.c, tableau.error)


# Gauss and Cowell --------------------------------------------------------------------------------


@pytest.mark.parametrize("stages", [1, 2, 3, 4])
def test_gauss_methods_have_twice_the_order_of_their_stages(stages):
    found = gauss_coefficients(stages)  # the constructor checks itself
    assert largest_miss(2 * stages, found.b, found.A)[0] < 1e-14
    assert largest_miss(2 * stages + 1, found.b, found.A)[0] > 1e-8
    np.testing.assert_allclose(found.bA, found.b * (1.0 - found.c), atol=1e-15)
    wrong = found.A.copy()
    wrong[0, 0] += 1e-9
    with pytest.raises(ValueError, match="the new point misses an order condition"):
        demand_order(2 * stages, found.b, wrong)


@pytest.mark.parametrize(
    ("name", "first", "to_rate", "rise", "degree", "unit"),
    [
        ("RISE", 1, False, True, 5, 1.0),
        ("RATE", 1, True, True, 6, 1.0),
        ("PREDICTED_RISE", 0, False, True, 5, 12.0),
        ("PREDICTED_RATE", 0, True, False, 5, 24.0),
        ("STIFF_RISE", 1, False, True, 3, 1.0),
        ("STIFF_RATE", 1, True, True, 2, 1.0),
    ],
)
def test_formulas_of_cowell_are_exact_for_polynomials(name, first, to_rate, rise, degree, unit):
    weights = [weight / unit for weight in getattr(cowell_formulas, name)]
    how = {"first": first, "to_rate": to_rate, "rise": rise}
    check_formula(name, weights, degree=degree, **how)
    with pytest.raises(ValueError, match=f"Cowell: {name} must be exact"):
        check_formula(name, weights, degree=degree + 1, **how)
    for place in range(len(weights)):
        wrong = list(weights)
        wrong[place] += 1e-7
        with pytest.raises(ValueError, match=f"Cowell: {name} must be exact"):
            check_formula(name, wrong, degree=degree, **how)
