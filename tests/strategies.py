"""Strategies of Hypothesis for numbers."""

from hypothesis import strategies as st


def between(low, high):
    """Draw numbers from low to high with nine decimals at most.

    Hypothesis likes 2e-313: tolerances relative to such a number underflow, and no arm has it.
    """
    return st.floats(low, high).map(lambda value: round(value, 9))
