"""The second-order theory of one link against its equations written out.

One cubic element: deflection v = N(x).p with p = (v_2, phi_2). With g(x) = int_0^x N' N'^T,

    S = int mu N,  a = int mu x N,  M = int mu N N^T,  D0 = int mu g,  D1 = int mu x g,
    s = S.p,  n = mc - p D0 p / 2,  J = I + p M p - p D1 p,

and the root accelerating by A (body axes Ax, Ay; gravity counts as -g) and turning at w,

    angle:  J w' + a.p'' - s Ax + n Ay + 2 w (p M p_dot - p D1 p_dot)             = tau
    shape:  a w' + M p'' - (D0 p) Ax + S Ay + K p - w^2 (M - D1) p
            + D0 p (p D0 p'' + p_dot D0 p_dot) / m                                = 0

A rigid link before it gives the root its acceleration.
"""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from flexarm.model import ArmSpec, Link

from .lagrangian import LagrangianOracle
from .textbook_beam import textbook_beam

LENGTH, RIGIDITY, DENSITY = 0.9, 35.0, 0.5
CRANK = 0.6  # m, length of the rigid link
GRAVITY = (3.0, -9.0)


def definite(polynomial):
    """Integral over the link, exact."""
    return polynomial.integ()(LENGTH)


def geometric_matrices():
    """D0 and D1 of the docstring by exact integration of polynomials."""
    x = Polynomial([0.0, 1.0])
    s = Polynomial([0.0, 1 / LENGTH])
    shapes = [s**2 * (3 - 2 * s), LENGTH * s**2 * (s - 1)]
    d0, d1 = np.zeros((2, 2)), np.zeros((2, 2))
    for i, first in enumerate(shapes):
        for j, second in enumerate(shapes):
            g = (first.deriv() * second.deriv()).integ()
            d0[i, j], d1[i, j] = definite(DENSITY * g), definite(DENSITY * x * g)
    return d0, d1


def test_equations_of_a_link_on_a_moving_root():
    link = Link(length=LENGTH, flexural_rigidity=RIGIDITY, mass_per_length=DENSITY, elements=1)
    crank = Link(length=CRANK, mass_per_length=0.3, flexible=False)
    spec = ArmSpec(links=[crank, link], gravity=GRAVITY, theory="second_order")
    oracle = LagrangianOracle(spec)
    book = textbook_beam(LENGTH, RIGIDITY, DENSITY, 1)
    d0, d1 = geometric_matrices()

    rng = np.random.default_rng(3)
    p, pd, pdd = rng.normal(size=(3, 2)) * [[0.05], [0.1], [2.0]]
    crank_angle, angle = 0.8, 0.5
    crank_rate, rate = 3.0, -1.2
    crank_acceleration, acceleration = 7.0, 4.0
    q = np.array([crank_angle, angle, *p])
    qd = np.array([crank_rate, rate, *pd])
    qdd = np.array([crank_acceleration, acceleration, *pdd])

    c, s = np.cos(crank_angle), np.sin(crank_angle)
    root = CRANK * (crank_acceleration * np.array([-s, c]) - crank_rate**2 * np.array([c, s]))
    c, s = np.cos(crank_angle + angle), np.sin(crank_angle + angle)
    ax, ay = np.array([[c, s], [-s, c]]) @ (root - GRAVITY)
    w, wd = crank_rate + rate, crank_acceleration + acceleration
    inertia = DENSITY * LENGTH**3 / 3 + p @ (book.mass - d1) @ p
    moment = DENSITY * LENGTH**2 / 2 - p @ d0 @ p / 2
    turning = (
        inertia * wd
        + book.moment @ pdd
        - (book.first @ p) * ax
        + moment * ay
        + 2 * w * p @ (book.mass - d1) @ pd
    )
    bending = (
        book.moment * wd
        + book.mass @ pdd
        - d0 @ p * ax
        + book.first * ay
        + book.stiffness @ p
        - w**2 * (book.mass - d1) @ p
        + d0 @ p * (p @ d0 @ pdd + pd @ d0 @ pd) / (DENSITY * LENGTH)
    )
    force = oracle.mass_matrix(q) @ qdd + oracle.bias_force(q, qd)
    # Rounding: forces here are sums of terms of at most 100 N.
    np.testing.assert_allclose(force[1:], [turning, *bending], rtol=0, atol=1e-12)


def test_tip_moves_towards_the_root():
    """Draw-in of a parabola v = k x^2 / 2 is k^2 L^3 / 6."""
    link = Link(length=LENGTH, flexural_rigidity=RIGIDITY, mass_per_length=DENSITY, elements=3)
    oracle = LagrangianOracle(ArmSpec(links=[link], theory="second_order"))
    k = 0.2
    x = LENGTH * np.arange(1, 4) / 3
    q = oracle.coordinates([0.0], [np.stack([k * x**2 / 2, k * x], axis=1)])
    exact = [LENGTH - k**2 * LENGTH**3 / 6, k * LENGTH**2 / 2, k * LENGTH]
    np.testing.assert_allclose(oracle.tip(q), exact, rtol=1e-14)


@pytest.mark.parametrize(("elements", "limit"), [(2, 1.463), (3, 1.264), (4, 1.172)])
def test_mass_matrix_is_positive_while_a_tip_load_bends_less_than_the_length(elements, limit):
    """Dropped terms matter where the joint turns one way and the whole link bends back.

    Almost no mass moves then, and with it vanishes the energy that outweighs what the truncation
    made negative. Without the energy of the mean shortening the limits are 0.109, 0.060, 0.039.
    """
    link = Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=elements)
    bare = ArmSpec(links=[link], theory="second_order")
    stiffness = LagrangianOracle(bare).stiffness[1:, 1:]
    tip_load = np.linalg.solve(stiffness, np.eye(2 * elements)[-2])

    def lowest(spec, deflection):
        q = np.concatenate([[0.0], tip_load * deflection / tip_load[-2]])
        return np.linalg.eigvalsh(LagrangianOracle(spec).mass_matrix(q))[0]

    assert lowest(bare, 0.98 * limit) > 0
    assert lowest(bare, 1.02 * limit) < 0
