"""Links in segments against the elastica: large deflection under a dead tip load.

Bisshopp and Drucker, Quarterly of Applied Mathematics 3 (1945) 272-275; the digits are those of
their elliptic integrals, alpha = P L^2 / EI: deflection, axial displacement of the tip, slope.
"""

import numpy as np
import pytest

import flexarm as fa

# Links bend further than their theory allows, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

ELASTICA = {
    1.0: (0.301720774, 0.056433236, 0.461351950),
    5.0: (0.713791524, 0.387628361, 1.215368118),
}
PIECES = (8, 16, 32)


def bent(alpha, segments, theory, elements=1, **link):
    """Return deflection, axial displacement and slope of a link of unit length and stiffness."""
    fields = {"flexural_rigidity": 1.0, "mass_per_length": 1.0, **link}
    link = fa.Link(length=1.0, elements=segments * elements, segments=segments, **fields)
    arm = fa.Arm(links=[link], theory=theory)
    x, y, angle = arm.tip(fa.equilibrium(arm, tip_force=(0.0, alpha)).q)
    return np.array([y, 1.0 - x, angle])


@pytest.mark.thorough_cases("linear-2-1.0")
@pytest.mark.parametrize("alpha", ELASTICA)
@pytest.mark.parametrize(("theory", "order"), [("linear", 2), ("second_order", 3)])
def test_order_of_segments(alpha, theory, order):
    """Linear segments keep their projected length, so their order is 2; second-order ones have
    3."""
    errors = [abs(bent(alpha, k, theory) - ELASTICA[alpha]) for k in PIECES]
    found = -np.diff(np.log2(errors), axis=0)
    # The axial displacement of linear segments approaches its order from above, 2.4 at alpha = 5.
    np.testing.assert_allclose(found[-1], order, atol=0.25)
    np.testing.assert_allclose(found[-1][[0, 2]], order, atol=0.06)


@pytest.mark.parametrize(("alpha", "within"), [(1.0, 1e-6), (5.0, 1.4e-5)])
def test_thirty_two_second_order_segments_are_accurate(alpha, within):
    np.testing.assert_allclose(bent(alpha, 32, "second_order"), ELASTICA[alpha], atol=within)


@pytest.mark.parametrize("elements", [2])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_more_elements_in_a_segment_do_not_reduce_the_error(theory, elements):
    """The kinematics of a segment limits the accuracy, not its mesh."""
    error = np.linalg.norm(bent(5.0, 8, theory) - ELASTICA[5.0])
    finer = np.linalg.norm(bent(5.0, 8, theory, elements) - ELASTICA[5.0])
    assert finer > 0.3 * error


def test_one_segment_has_the_small_deflection_theory():
    deflection, draw_in, slope = bent(5.0, 1, "linear")
    np.testing.assert_allclose([deflection, slope], [5 / 3, 5 / 2], rtol=1e-12)
    assert draw_in == 0.0


@pytest.mark.parametrize("pieces", [16, 32])
@pytest.mark.parametrize("theory", ["linear", "second_order"])
def test_moment_bends_a_link_into_a_circle(pieces, theory):
    """M = 2 pi EI / L: segments turn by the exact angle to rounding, in either theory."""
    link = fa.Link(
        length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=pieces, segments=pieces
    )
    arm = fa.Arm(links=[link], theory=theory)
    result = fa.equilibrium(arm, tip_force=(0.0, 0.0, 2.0 * np.pi))
    x, y, angle = arm.tip(result.q)
    assert angle == pytest.approx(2.0 * np.pi, rel=1e-12)
    # The polygon of equal chords is closed.
    np.testing.assert_allclose([x, y], 0.0, atol=1e-12)
    # The opposite point is a diameter away, except for the second-order lengthening of the chords.
    far = np.linalg.norm(arm.shape(result.q, 201)[0], axis=1).max()
    assert far == pytest.approx(1.0 / np.pi, rel=7.0 / pieces**2)


def test_stiff_end_is_a_rigid_lever():
    """The outer half of a table across segments is ten thousand times as stiff."""
    x, rigidity = [0.0, 0.5, 0.5001, 1.0], [1.0, 1.0, 1e4, 1e4]
    table = {"x": x, "flexural_rigidity": rigidity, "mass_per_length": [1.0] * 4}
    whole = bent(
        1.0, 16, "second_order", 2, flexural_rigidity=None, mass_per_length=None, table=table
    )
    half = fa.Link(length=0.5, flexural_rigidity=1.0, mass_per_length=1.0, elements=16, segments=8)
    lever = fa.Link(length=0.5, mass_per_length=1.0, flexible=False)
    arm = fa.Arm(links=[half, lever], theory="second_order")
    x_tip, y_tip, angle = arm.tip(fa.equilibrium(arm, tip_force=(0.0, 1.0)).q)
    # 1e-4 of the length is softer, and the lever bends by 1e-4 of the other half's deflection.
    np.testing.assert_allclose(whole, [y_tip, 1.0 - x_tip, angle], rtol=1e-3)
