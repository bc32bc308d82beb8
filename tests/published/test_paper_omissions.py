"""Terms that the paper omits, and its example: stiffening, rotary inertia, lumps, Table I."""

import numpy as np
import pytest
import scipy.linalg
import sympy as sp

from .paper_arm import (
    COS,
    ELBOW_VELOCITY,
    EXACT,
    I1,
    I2,
    J1,
    J2,
    LENGTH1,
    LENGTH2,
    MU1,
    MU2,
    ONE,
    Q1,
    Q1D,
    Q1DD,
    Q2,
    Q2D,
    Q2DD,
    QD,
    QDD,
    R2,
    RATE1,
    RATE2,
    SIN,
    T1,
    TWO,
    V_TIP,
    ZERO,
    N,
    Q,
    X,
    along,
    carried_force,
    equal,
    integral,
    lagrange,
    random_state,
    rate,
)

ELASTIC = (*Q1, *Q2, *Q1D, *Q2D, *Q1DD, *Q2DD)


def rayleigh_ritz(functions: int, foreshortening: bool, spin: float) -> np.ndarray:
    """Return squared frequencies of K + spin^2 (K_G - M), length, EI and mu one, polynomials x^2
    ..."""
    shapes = sp.Matrix([[X ** (k + 2) for k in range(functions)]])
    slope = shapes.diff(X)
    curvature = slope.diff(X)
    mass = along(shapes.T * shapes, sp.Integer(1))
    stiffness = along(curvature.T * curvature, sp.Integer(1))
    geometric = along((1 - X**2) / 2 * slope.T * slope, sp.Integer(1))
    effective = stiffness + sp.Rational(spin) ** 2 * (int(foreshortening) * geometric - mass)
    # forty digits because monomials are ill-conditioned in float64
    factor = np.array(sp.Matrix(mass).evalf(40).cholesky().inv().tolist(), dtype=object)
    reduced = factor @ np.array(effective.evalf(40).tolist(), dtype=object) @ factor.T
    return scipy.linalg.eigvalsh(reduced.astype(float))


def test_spin_softening_and_the_sign_of_geometric_stiffness() -> None:
    """Printed K - M w^2 collapses at the first frequency; foreshortening makes it grow."""
    at_rest = np.sqrt(rayleigh_ritz(2, False, 0.0))
    # clamped-free frequencies of one Hermite element, published with the ten decimals shown
    assert at_rest == pytest.approx([3.5327315428, 34.8068931082], abs=5e-11)
    assert rayleigh_ritz(2, False, 3.53)[0] > 0 > rayleigh_ritz(2, False, 3.54)[0]
    # Lag frequency of a clamped beam spinning about its root at 2 (dimensionless): 3.62179696412,
    # from the exact differential equation. Eight polynomials have an error below 1e-8.
    assert np.sqrt(rayleigh_ritz(8, True, 2.0)[0]) == pytest.approx(3.62179696412, abs=1e-8)
    assert rayleigh_ritz(8, True, 10.0)[0] > rayleigh_ritz(8, True, 2.0)[0]
    softened = rayleigh_ritz(8, False, 2.0)[0]
    assert softened == pytest.approx(3.5160152685**2 - 4.0, abs=1e-8)


@pytest.mark.thorough
def test_geometric_stiffness_uses_the_whole_axial_force() -> None:
    """Points at x - 1/2 int v'^2, linearised about the straight arm, against int T N'^T N' dx."""
    elbow_mass, payload = sp.Rational(2, 3), sp.Rational(1, 4)
    gravity = sp.Matrix([sp.Rational(3, 2), -sp.Rational(49, 5)])
    slope = N.diff(X)
    metric = (slope.T * slope).applyfunc(lambda e: sp.integrate(e, X))  # int_0^x N'^T N'

    def positions(on: int) -> tuple[sp.Matrix, sp.Matrix, sp.Matrix]:
        u1, u2 = (-on * (q.T * metric * q)[0] / 2 for q in (Q1, Q2))
        first = (X + u1) * I1 + (N * Q1)[0] * J1
        elbow = first.subs(X, LENGTH1)
        return first, elbow, elbow + (X + u2) * I2 + (N * Q2)[0] * J2

    def rows(position: sp.Matrix, state: dict[sp.Expr, sp.Expr]) -> sp.Matrix:
        """Return Lagrange's left side for a unit point mass: (acceleration - gravity) . dR/dq."""
        apparent = (rate(rate(position)) - gravity).xreplace(state)
        return position.jacobian(Q).xreplace(state).T * apparent

    def added(with_u: sp.Matrix, without_u: sp.Matrix, seed: int) -> sp.Matrix:
        """Return the part of the shortening's effect that is linear in the elastic coordinates."""
        epsilon = sp.Symbol("epsilon")
        state = random_state(seed)
        state.update({symbol: epsilon * state[symbol] for symbol in ELASTIC})
        difference = rows(with_u, state) - rows(without_u, state)
        return difference.applyfunc(lambda e: sp.expand(e).coeff(epsilon, 1))

    straight = dict.fromkeys(ELASTIC, ZERO)
    apparent = rate(ELBOW_VELOCITY).xreplace(straight) - gravity
    force = carried_force().xreplace(straight)
    force += payload * rate(rate(R2.subs(X, LENGTH2))).xreplace(straight)
    s = sp.Symbol("s")
    tension2 = sp.integrate(MU2 * (RATE2**2 * s - apparent.dot(I2)), (s, X, LENGTH2))
    tension2 += payload * (RATE2**2 * LENGTH2 - apparent.dot(I2))
    tension1 = sp.integrate(MU1 * (RATE1**2 * s + gravity.dot(I1)), (s, X, LENGTH1))
    tension1 -= (force - (TWO.M4 + payload) * gravity + elbow_mass * apparent).dot(I1)
    pairs = list(zip(positions(1), positions(0), strict=True))
    for seed in (1, 2):
        first, elbow, second = (added(*pair, seed) for pair in pairs)
        ours = along(MU1 * first, LENGTH1) + elbow_mass * elbow
        ours += along(MU2 * second, LENGTH2) + payload * second.subs(X, LENGTH2)
        state = random_state(seed)
        stiffness1 = along((tension1 * slope.T * slope).xreplace(state), LENGTH1)
        stiffness2 = along((tension2 * slope.T * slope).xreplace(state), LENGTH2)
        assert ours[1:3, 0] == stiffness1 * Q1.xreplace(state)
        assert ours[4:6, 0] == stiffness2 * Q2.xreplace(state)


def test_rotary_inertia_has_no_part_in_the_centripetal_term() -> None:
    """The intended term of (2) and (9), and a tip inertia: 1/2 J (w + d/dt v')^2."""
    density, tip_inertia = sp.Rational(2, 9), sp.Rational(3, 8)
    slope = N.diff(X)
    section = RATE1 + (slope * Q1D)[0]
    energy = integral(density * section**2 / 2, 0, LENGTH1)
    energy += tip_inertia * section.subs(X, LENGTH1) ** 2 / 2
    rotary = along(density * slope.T * slope, LENGTH1)
    rotary += tip_inertia * ONE.tip_slope.T * ONE.tip_slope
    row = along(density * slope, LENGTH1) + tip_inertia * ONE.tip_slope
    total = density * LENGTH1 + tip_inertia
    added = sp.Matrix([total * QDD[0] + (row * Q1DD)[0], rotary * Q1DD + row.T * QDD[0]])
    assert equal(lagrange(T1 + energy)[:3, 0], lagrange(T1)[:3, 0] + added)


def test_lumps_in_the_mass_matrix() -> None:
    """Elbow mass: M4 of the link 1 rows. Housing inertia: three blocks, not only M_1q1."""
    mass, housing = sp.Rational(2, 3), sp.Rational(3, 8)
    section = RATE1 + (ONE.tip_slope * Q1D)[0]
    energy = mass * ELBOW_VELOCITY.dot(ELBOW_VELOCITY) / 2 + housing * section**2 / 2
    row = mass * LENGTH1 * ONE.tip + housing * ONE.tip_slope
    block = mass * ONE.tip.T * ONE.tip + housing * ONE.tip_slope.T * ONE.tip_slope
    corner = sp.Matrix([[mass * (LENGTH1**2 + V_TIP**2) + housing]])
    added = sp.zeros(6)
    added[:3, :3] = sp.Matrix(sp.BlockMatrix([[corner, row], [row.T, block]]))
    assert equal(sp.hessian(energy, list(QD)), added)


def test_rigid_limit_of_the_table_1_arm() -> None:
    rigid = dict.fromkeys(ELASTIC, ZERO)
    inertia_1 = ONE.inertia + TWO.M4 * LENGTH1**2
    coupling = TWO.M3 * LENGTH1
    first = inertia_1 * QDD[0] + coupling * (COS * QDD[3] + SIN * RATE2**2)
    second = TWO.inertia * QDD[3] + coupling * (COS * QDD[0] - SIN * RATE1**2)
    assert equal(EXACT.xreplace(rigid)[[0, 3], 0], sp.Matrix([first, second]))
    length, mu = 1.4142, 0.61732  # Table I; link 2 is 1 m of the same rod
    # ten decimals are printed in docs/theory/paper.md
    assert mu * length**3 / 3 + mu * length**2 == pytest.approx(1.8166144527, abs=5e-11)
    assert mu / 3 == pytest.approx(0.2057733333, abs=5e-11)
    assert mu * length / 2 == pytest.approx(0.4365069720, abs=5e-11)
    # a 10 mm steel rod of 7860 kg/m^3 has the mass of the table, to its five digits
    assert 7860.0 * np.pi / 4 * 0.01**2 == pytest.approx(mu, abs=5e-6)


def our_torques(duration: float, samples: int) -> np.ndarray:
    """Return rigid torques of the Table I arm on the line from (2, 1) to (1, 2), (samples, 2)."""
    length, mu = 1.4142, 0.61732
    first, second, coupling = mu * length**3 / 3 + mu * length**2, mu / 3, mu * length / 2
    peaks = []
    for u in np.linspace(0.0, 1.0, samples):
        s = 10 * u**3 - 15 * u**4 + 6 * u**5
        s_rate = (30 * u**2 - 60 * u**3 + 30 * u**4) / duration
        s_acceleration = (60 * u - 180 * u**2 + 120 * u**3) / duration**2
        x, y = 2.0 - s, 1.0 + s
        relative = -np.arccos((x * x + y * y - length**2 - 1.0) / (2.0 * length))
        one = np.arctan2(y, x) - np.arctan2(np.sin(relative), length + np.cos(relative))
        two = one + relative
        arms = np.array([[np.cos(one), np.cos(two)], [np.sin(one), np.sin(two)]]) * [length, 1.0]
        jacobian = np.array([-arms[1], arms[0]])
        rates = np.linalg.solve(jacobian, np.array([-1.0, 1.0]) * s_rate)
        centripetal = -arms @ rates**2
        acceleration = np.array([-1.0, 1.0]) * s_acceleration - centripetal
        angular = np.linalg.solve(jacobian, acceleration)
        c, sn = coupling * np.cos(relative), -coupling * np.sin(relative)
        difference = first * angular[0] + c * angular[1] + sn * rates[1] ** 2
        tau2 = second * angular[1] + c * angular[0] - sn * rates[0] ** 2
        peaks.append((difference + tau2, tau2))
    return np.array(peaks)


def test_torques_of_our_example() -> None:
    torques = our_torques(duration=1.0, samples=2001)
    # two decimals are printed in docs/theory/paper.md
    assert torques.max(axis=0) == pytest.approx([11.21, 1.63], abs=0.005)
    assert torques.min(axis=0) == pytest.approx([-8.87, -1.90], abs=0.005)
    assert our_torques(duration=2.0, samples=2001) == pytest.approx(torques / 4.0, rel=1e-9)


def test_start_of_our_example_path() -> None:
    length, reach = 1.4142, np.hypot(2.0, 1.0)
    elbow = -np.arccos((reach**2 - length**2 - 1.0) / (2.0 * length))
    theta1 = np.arctan2(1.0, 2.0) - np.arctan2(np.sin(elbow), length + np.cos(elbow))
    # digits as printed in docs/theory/paper.md
    assert theta1 == pytest.approx(0.785388573, abs=5e-10)
    assert theta1 + elbow == pytest.approx(0.0000191804, abs=5e-11)
