"""Sampled plants: exact whatever the scales of the states are."""

from decimal import Decimal, localcontext

import numpy as np

from flexarm.control.hardware.sampled_plant import held

#: Terms of the series and squarings: the argument is below 1e-4, so that the rest is below 1e-60.
TERMS, SQUARINGS = 14, 20


def exponential(matrix: np.ndarray) -> np.ndarray:
    """Return the exponential of a matrix by its series, with 100 decimal digits."""
    with localcontext() as context:
        context.prec = 100
        exact = np.vectorize(Decimal, otypes=[object])(matrix) / 2**SQUARINGS
        total = term = np.vectorize(Decimal, otypes=[object])(np.eye(len(matrix)))
        for k in range(1, TERMS):
            term = term.dot(exact) / k
            total = total + term
        for _ in range(SQUARINGS):
            total = total.dot(total)
        return total.astype(float)


def test_a_state_that_hardly_acts_is_held_exactly():
    """Its scale exceeds all integers: SciPy's own function that balances matrices warns."""
    A, B = np.zeros((6, 6)), np.zeros((6, 2))
    A[:3, 3:] = np.eye(3)
    # A gantry that a beam pulls across its rail, but for rounding.
    A[3, 1:3], A[3, 4:] = (1.2e-17, -2.6e-16), (4e-20, -1e-19)
    A[4, 1:3], A[4, 4:] = (-44.0, 325.0), (-0.15, 0.17)
    A[5, 1:3], A[5, 4:] = (8.3, -1453.0), (0.03, -0.77)
    A[3:, 0] = 3e-64, -1.5e-46, 1e-46
    B[3:, 0], B[3:, 1] = (2e-5, 1e-4, 2e-4), (1e-22, 3e-5, 1e-4)
    whole = np.zeros((8, 8))
    whole[:6, :6], whole[:6, 6:] = 0.01 * A, 0.01 * B
    exact = exponential(whole)[:6]
    moved, pushed = held(A, B, 0.01)
    # Of each entry: they differ by 46 orders of magnitude.
    np.testing.assert_allclose(moved, exact[:, :6], rtol=1e-12)
    np.testing.assert_allclose(pushed, exact[:, 6:], rtol=1e-12)
