"""Tables that sample a taper too coarsely: the estimate of their error and the warning."""

import warnings

import numpy as np
import pytest

import flexarm as fa


def tapered(points, tip, elements=16):
    """Return a wedge whose depth decreases linearly to a fraction ``tip`` of that at the root."""
    x = np.linspace(0.0, 1.0, points)
    depth = 0.02 * (1.0 - (1.0 - tip) * x)
    table = fa.SectionTable(
        x=x, flexural_rigidity=70e9 * 0.02 * depth**3 / 12.0, mass_per_length=54.0 * depth
    )
    return fa.Arm(
        links=[fa.Link(length=1.0, table=table, elements=elements)], joints=[fa.Joint(fixed=True)]
    )


@pytest.mark.parametrize(("points", "tip"), [(5, 0.3), (9, 0.1), (5, 0.1)])
def test_the_warning_states_the_error_of_the_frequency(points, tip):
    with pytest.warns(fa.AccuracyWarning, match=r"table has \d+ points") as caught:
        coarse = tapered(points, tip)
    exact = tapered(801, tip)
    error = abs(fa.modes(coarse).frequency_hz[0] / fa.modes(exact).frequency_hz[0] - 1.0)
    stated = float(str(caught[0].message).split("about ")[1].split(" %")[0]) / 100.0
    # The interpolation between the two, and one step towards the shape of the mode.
    assert stated == pytest.approx(error, rel=0.15)


@pytest.mark.parametrize(("points", "tip"), [(801, 0.1), (9, 0.5), (33, 0.1)])
def test_fine_tables_do_not_warn(points, tip):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tapered(points, tip)


def test_jumps_and_straight_pieces_do_not_warn():
    """A tube with a thicker end, and a table of straight pieces between few points."""
    stepped = fa.SectionTable(
        x=[0.0, 0.3, 0.301, 0.6, 0.601, 1.0],
        flexural_rigidity=[200.0, 200.0, 120.0, 120.0, 60.0, 60.0],
        mass_per_length=[1.0, 1.0, 0.8, 0.8, 0.5, 0.5],
    )
    pieces = fa.SectionTable(
        x=[0.0, 0.2, 0.7, 1.0],
        flexural_rigidity=[200.0, 50.0, 40.0, 5.0],
        mass_per_length=[1.0, 0.5, 0.5, 0.1],
    )
    for table in (stepped, pieces):
        fa.Arm(links=[fa.Link(length=1.0, table=table)])
