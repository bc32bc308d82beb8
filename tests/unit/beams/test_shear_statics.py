"""Static deflections of links with shear: exact at the nodes of a uniform link."""

import numpy as np
import pytest

from beam_links import flexible_link

L, EI, MU, KGA = 1.4, 105.0, 0.6, 400.0
# Handbook values, to the rounding of sums over at most 64 coordinates.
EXACT = 1e-12


def uniform(elements, modes=None, shear=KGA):
    two = np.ones(2)
    return flexible_link(
        [0.0, L],
        EI * two,
        MU * two,
        0.0 * two,
        elements=elements,
        modes=modes,
        shear_rigidity=shear * two,
    )


@pytest.mark.parametrize("shear", [4.0, KGA, 1e9])
@pytest.mark.parametrize("elements", [1, 2, 5, 32])
class TestUniformCantilever:
    def test_tip_force_and_moment(self, elements, shear):
        link = uniform(elements, shear=shear)
        force, moment = link.P / link.w2, link.dP / link.w2
        assert link.P @ force == pytest.approx(L**3 / (3 * EI) + L / shear, rel=EXACT)
        assert link.dP @ force == pytest.approx(L**2 / (2 * EI), rel=EXACT)
        assert link.P @ moment == pytest.approx(L**2 / (2 * EI), rel=EXACT)
        assert link.dP @ moment == pytest.approx(L / EI, rel=EXACT)

    def test_uniform_load(self, elements, shear):
        link = uniform(elements, shear=shear)
        bent = link.S / MU / link.w2
        exact = L**4 / (8 * EI) + L**2 / (2 * shear)
        assert link.P @ bent == pytest.approx(exact, rel=EXACT)
        assert link.dP @ bent == pytest.approx(L**3 / (6 * EI), rel=EXACT)

    def test_uniform_load_is_exact_at_every_node(self, elements, shear):
        link = uniform(elements, shear=shear)
        x = np.linspace(0.0, L, elements + 1)[1:]
        nodal = (link.basis @ (link.S / MU / link.w2)).reshape(elements, 2)
        deflection = x**2 * (6 * L**2 - 4 * L * x + x**2) / (24 * EI)
        deflection += x * (2 * L - x) / (2 * shear)
        rotation = x * (3 * L**2 - 3 * L * x + x**2) / (6 * EI)
        # If most of the deflection is due to shear, rotations are accurate to a thousandth of its
        # digits.
        np.testing.assert_allclose(nodal, np.stack([deflection, rotation], axis=1), rtol=1e-10)

    def test_root_has_moment_and_shear_force_of_a_tip_force(self, elements, shear):
        link = uniform(elements, shear=shear)
        bent = link.P / link.w2
        assert EI * (link.curvature([0.0]) @ bent)[0] == pytest.approx(L, rel=1e-10)
        angle = ((link.slope([0.0]) - link.rotation([0.0])) @ bent)[0]
        # Sums over 64 shapes, the stiffest of which are steep at the root.
        assert shear * angle == pytest.approx(1.0, rel=1e-9)
        np.testing.assert_allclose(link.rotation([0.0]), 0.0, atol=1e-13)


@pytest.mark.parametrize("modes", [2, 3, 6])
def test_reduced_shapes_carry_tip_loads_exactly(modes):
    link = uniform(8, modes)
    assert link.P @ (link.P / link.w2) == pytest.approx(L**3 / (3 * EI) + L / KGA, rel=EXACT)
    assert link.dP @ (link.P / link.w2) == pytest.approx(L**2 / (2 * EI), rel=EXACT)
    assert link.dP @ (link.dP / link.w2) == pytest.approx(L / EI, rel=EXACT)


def test_tapered_tip_compliance_converges_to_castigliano():
    """Against the integrals of M(x)^2/EI(x) and Q^2/kGA(x); the link is never too soft."""
    bending, shear = np.array([3.0, 0.5]), np.array([20.0, 4.0])
    node, weight = np.polynomial.legendre.leggauss(40)
    s = (node + 1) / 2
    lever, rigidity = 1 - s, np.interp(s, [0, 1], bending)
    exact = weight @ (lever**2 / rigidity + 1 / np.interp(s, [0, 1], shear)) / 2
    missed = []
    for elements in (16, 32, 64):
        link = flexible_link(
            [0.0, 1.0], bending, [1.0, 1.0], [0.0, 0.0], elements=elements, shear_rigidity=shear
        )
        missed.append(1 - link.P @ (link.P / link.w2) / exact)
    assert min(missed) > 0.0
    # Linear curvature with a stiffness that varies inside an element: fourth order.
    np.testing.assert_allclose(np.log2(np.array(missed[:-1]) / missed[1:]), 4.0, atol=0.06)
    assert missed[-1] < 1e-7
