"""The second-order theory of one link against its equations written out.

One cubic element: deflection v = N(x).p with p = (v_2, phi_2). With g(x) = int_0^x N' N'^T,

    S = int mu N,  a = int mu x N,  M = int mu N N^T,  D0 = int mu g,  D1 = int mu x g,
    s = S.p,  sigma = -p D0 p / 2,  chi = -p D1 p / 2,

the rigid motion A + B x across the axis that stands for the shortening,

    m A + mc B = sigma,    (1 + B)^2 = 1 + y + y^4 / 8,
    (I - mc^2 / m) y = 2 chi - (2 mc + sigma) sigma / m,

the momenta of the turning and bending link

    Y = (mc + sigma) w + S.p_dot,    H = (mc A + I (1 + B)) w + a.p_dot,

and the root accelerating by (Ax, Ay) (body axes; gravity counts as -g) and turning at w, the mean
acceleration along x is

    X = Ax - (p D0 p'' + p_dot D0 p_dot + w' s + w s_dot) / m - w (Y dA/dsigma + H dB/dsigma)

and, with J = I + p M p + 2 chi + (I - mc^2 / m) y^4 / 8,

    angle:  J w' + w J_dot + (1 + B) a.p'' + A S.p'' - s Ax + (mc + sigma) Ay
            + s (p D0 p'' + p_dot D0 p_dot) / m + A_dot s_dot + B_dot a.p_dot
            - sigma_dot s_dot / m                                                 = tau
    shape:  a ((1 + B) w' + w B_dot) + S (Ay + A w' + w A_dot + w sigma_dot / m) + M p''
            - D0 p X + K p - w^2 M p + w D1 p (Y dA/dchi + H dB/dchi)             = 0

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


def test_equations_of_a_link_on_a_moving_root_hold():
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
    m, mc, about_root = DENSITY * LENGTH * np.array([1.0, LENGTH / 2, LENGTH**2 / 3])
    first, moment = book.first, book.moment
    sd, sigma_dot, chi_dot = first @ pd, -p @ d0 @ pd, -p @ d1 @ pd
    sigma, chi = -p @ d0 @ p / 2, -p @ d1 @ p / 2
    pulled = p @ d0 @ pdd + pd @ d0 @ pd
    central = about_root - mc**2 / m
    y = (2 * chi - (2 * mc + sigma) * sigma / m) / central
    tilt = np.sqrt(1 + y + y**4 / 8) - 1
    tilt_by_y = (1 + y**3 / 2) / (2 * (1 + tilt))
    tilt_by = tilt_by_y * np.array([-2 * (mc + sigma) / m, 2]) / central  # sigma, chi
    lift = (sigma - mc * tilt) / m
    lift_by = (np.array([1, 0]) - mc * tilt_by) / m
    lift_dot, tilt_dot = (by @ [sigma_dot, chi_dot] for by in (lift_by, tilt_by))
    rise, turn = (mc + sigma) * w + sd, (mc * lift + about_root * (1 + tilt)) * w + moment @ pd
    momentum_by = rise * lift_by + turn * tilt_by
    along = ax - (pulled + wd * first @ p + w * sd) / m - w * momentum_by[0]
    y_dot = tilt_dot / tilt_by_y
    inertia = about_root + p @ book.mass @ p + 2 * chi + central * y**4 / 8
    inertia_dot = 2 * (p @ book.mass @ pd + chi_dot) + central * y**3 * y_dot / 2
    turning = (
        inertia * wd
        + w * inertia_dot
        + (1 + tilt) * moment @ pdd
        + lift * first @ pdd
        - (first @ p) * ax
        + (mc + sigma) * ay
        + first @ p * pulled / m
        + lift_dot * sd
        + tilt_dot * moment @ pd
        - sigma_dot * sd / m
    )
    bending = (
        moment * ((1 + tilt) * wd + w * tilt_dot)
        + first * (ay + lift * wd + w * lift_dot + w * sigma_dot / m)
        + book.mass @ pdd
        - d0 @ p * along
        + book.stiffness @ p
        - w**2 * book.mass @ p
        + w * d1 @ p * momentum_by[1]
    )
    force = oracle.mass_matrix(q) @ qdd + oracle.bias_force(q, qd)
    # Rounding: forces here are sums of terms of at most 100 N.
    np.testing.assert_allclose(force[1:], [turning, *bending], rtol=0, atol=1e-12)


def test_tip_moves_towards_the_root():
    """The axial displacement of a parabola v = k x^2 / 2 is k^2 L^3 / 6."""
    link = Link(length=LENGTH, flexural_rigidity=RIGIDITY, mass_per_length=DENSITY, elements=3)
    oracle = LagrangianOracle(ArmSpec(links=[link], theory="second_order"))
    k = 0.2
    x = LENGTH * np.arange(1, 4) / 3
    q = oracle.coordinates([0.0], [np.stack([k * x**2 / 2, k * x], axis=1)])
    exact = [LENGTH - k**2 * LENGTH**3 / 6, k * LENGTH**2 / 2, k * LENGTH]
    np.testing.assert_allclose(oracle.tip(q), exact, rtol=1e-14)


@pytest.mark.thorough_cases("5")
@pytest.mark.parametrize("elements", [1, 2, 5])
def test_mass_matrix_is_positive_for_any_deflection(elements):
    """The kinetic energy is a sum of squares.

    Links on free joints without a hub are the worst case.
    """
    link = Link(length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=elements)
    oracle = LagrangianOracle(ArmSpec(links=[link, link], theory="second_order"))
    stiffness = oracle.stiffness[1 : 1 + 2 * elements, 1 : 1 + 2 * elements]
    shapes = np.linalg.eigh(stiffness)[1].T
    rng = np.random.default_rng(elements)
    for deflection in (0.01, 0.1, 1.0):
        for shape in shapes[:6]:
            bent = shape * deflection / np.abs(shape[::2]).max()
            mass = oracle.mass_matrix(np.concatenate([[0.0], bent, [rng.normal()], -bent]))
            scale = np.sqrt(np.diag(mass))
            # Without the terms of higher order values are below -0.1; rounding gives -3e-17.
            assert np.linalg.eigvalsh(mass / np.outer(scale, scale))[0] > -1e-14
