"""The printed equations (1) to (27) of "Dynamic Modeling of Tow Flexible Link Manipulators".

Every claim of docs/theory/paper.md that algebra can decide is tested here, in the order of the
paper: correct equations, wrong ones, and their corrections. Notation: paper_arm.
"""

import pytest
import sympy as sp
from sympy.core.expr import Expr

from .paper_arm import (
    COS,
    ELBOW,
    ELBOW_VELOCITY,
    EXACT,
    I1,
    I2,
    J1,
    J2,
    LENGTH1,
    ONE,
    Q1,
    Q1D,
    Q1DD,
    Q2,
    Q2D,
    Q2DD,
    QD,
    QDD,
    R1,
    R2,
    RATE1,
    RATE2,
    RIGIDITY1,
    SIN,
    STATIC2,
    STATIC2_RATE,
    T1,
    T2,
    THETA1,
    THETA2,
    TWO,
    V_TIP,
    V_TIP_RATE,
    VOX,
    VOX_RATE,
    VOY,
    VOY_RATE,
    N,
    Q,
    U,
    X,
    axes,
    carried_force,
    equal,
    integral,
    lagrange,
    rate,
)


def printed_24_25() -> sp.Matrix:
    """Return the left sides of (25), the angle, and (24), the deflection."""
    spin = (Q1.T * ONE.M1 * Q1)[0]
    angle = (ONE.a * Q1DD)[0] + (ONE.inertia + spin) * QDD[0]
    angle += 2 * (Q1D.T * ONE.M1 * Q1)[0] * RATE1
    return sp.Matrix([angle, ONE.M1 * Q1DD + ONE.a.T * QDD[0] + (ONE.K - ONE.M1 * RATE1**2) * Q1])


def printed_26a(vox_rate: Expr, voy_rate: Expr) -> Expr:
    spin = (Q2.T * TWO.M1 * Q2)[0]
    return (
        (TWO.inertia + spin) * QDD[3]
        + (TWO.a * Q2DD)[0]
        - STATIC2 * vox_rate
        + voy_rate * TWO.M3
        + 2 * (Q2D.T * TWO.M1 * Q2)[0] * RATE2
        - STATIC2_RATE * VOX
    )


def printed_26b(voy_rate: Expr) -> sp.Matrix:
    stiffness = (TWO.K - TWO.M1 * RATE2**2) * Q2
    return TWO.a.T * QDD[3] + TWO.M1 * Q2DD + stiffness + TWO.M2 * (voy_rate + VOX * RATE2)


def test_kinetic_energy_integrands_6_and_14_are_right() -> None:
    v, vd = (N * Q1)[0], (N * Q1D)[0]
    printed = v**2 * RATE1**2 + vd**2 + X**2 * RATE1**2 + 2 * vd * X * RATE1
    assert equal(rate(R1).dot(rate(R1)), printed)
    w, wd = (N * Q2)[0], (N * Q2D)[0]
    printed = VOX**2 + w**2 * RATE2**2 - 2 * VOX * w * RATE2 + VOY**2 + X**2 * RATE2**2
    printed += wd**2 + 2 * VOY * X * RATE2 + 2 * VOY * wd + 2 * X * RATE2 * wd
    assert equal(rate(R2).dot(rate(R2)), printed)


def test_missing_elbow_velocity_of_10_to_12() -> None:
    across = LENGTH1 * RATE1 + V_TIP_RATE
    assert equal(VOX, -V_TIP * RATE1 * COS - across * SIN)
    assert equal(VOY, -V_TIP * RATE1 * SIN + across * COS)


def test_strain_energy_15_16_needs_the_square() -> None:
    curvature = (N.diff(X, 2) * Q1)[0]
    printed = integral(RIGIDITY1 * curvature / 2, 0, LENGTH1)
    squared = integral(RIGIDITY1 * curvature**2 / 2, 0, LENGTH1)
    bent_other_way = dict(zip(Q1, -Q1, strict=True))
    assert equal(printed.xreplace(bent_other_way), -printed)  # negative, so it is not an energy
    assert equal(squared, (Q1.T * ONE.K * Q1)[0] / 2)


def test_element_integrals_on_the_reference_interval() -> None:
    """x = (2i - 1 + eta) l / 2 and J = l / 2, and K carries J^-3 with N''^T N''."""
    eta, half = sp.Symbol("eta"), sp.Rational(3, 10)
    hermite = sp.Matrix(
        [
            [
                (1 - eta) ** 2 * (2 + eta) / 4,
                half * (1 - eta) ** 2 * (1 + eta) / 4,
                (1 + eta) ** 2 * (2 - eta) / 4,
                half * (1 + eta) ** 2 * (eta - 1) / 4,
            ]
        ]
    )
    second = hermite.diff(eta, 2)
    stiffness = (second.T * second * half**-3).applyfunc(lambda e: sp.integrate(e, (eta, -1, 1)))
    h = 2 * half
    textbook = sp.Matrix(
        [
            [12, 6 * h, -12, 6 * h],
            [6 * h, 4 * h**2, -6 * h, 2 * h**2],
            [-12, -6 * h, 12, -6 * h],
            [6 * h, 2 * h**2, -6 * h, 4 * h**2],
        ]
    )
    assert stiffness == textbook / h**3
    with pytest.raises(sp.matrices.exceptions.ShapeError):
        second * second  # as printed, without the transpose
    for i in (1, 2, 3):
        x = (2 * i - 1 + eta) * h / 2
        for power in (0, 1, 2):  # M4, M3, I
            ours = sp.integrate(x**power * half, (eta, -1, 1))
            assert ours == sp.integrate(X**power, (X, (i - 1) * h, i * h))


def test_kinetic_energy_in_coordinates_has_wrong_transposes() -> None:
    with pytest.raises(sp.matrices.exceptions.ShapeError):
        Q2.T * TWO.M2.T
    energy = TWO.M4 * (VOX**2 + VOY**2) + (Q2.T * TWO.M1 * Q2)[0] * RATE2**2
    energy += -2 * VOX * (Q2.T * TWO.M2)[0] * RATE2 + (Q2D.T * TWO.M1 * Q2D)[0]
    energy += TWO.inertia * RATE2**2 + 2 * VOY * (Q2D.T * TWO.M2)[0]
    energy += 2 * VOY * TWO.M3 * RATE2 + 2 * (Q2D.T * TWO.a.T)[0] * RATE2
    assert equal(T2, energy / 2)


def test_23_with_relative_motor_work_bends_link_1() -> None:
    """A couple -tau2 on link 1's tip section, as two forces, has Q_q1 = -tau2 N'(L1)^T."""
    tau2, arm = sp.Rational(5, 3), sp.Rational(1, 9)
    psi = THETA1 + (ONE.tip_slope * Q1)[0]
    tangent, normal = axes(psi)
    force = tau2 / (2 * arm) * tangent  # at +arm; its moment is -tau2 / 2
    upper, lower = ELBOW + arm * normal, ELBOW - arm * normal
    work = upper.jacobian(Q).T * force - lower.jacobian(Q).T * force
    angle = {sp.cos(psi): sp.Rational(3, 5), sp.sin(psi): sp.Rational(4, 5)}
    expected = sp.Matrix([-tau2, *(-tau2 * ONE.tip_slope), 0, 0, 0])
    assert equal(work.xreplace(angle), expected)
    whole = tau2 * sp.Matrix([THETA2 - psi]).jacobian(Q).T  # tau2 d(relative angle)
    assert whole == expected + sp.Matrix([0, 0, 0, tau2, 0, 0])


def test_24_25_hold_for_a_single_link_only() -> None:
    printed = printed_24_25()
    assert equal(lagrange(T1, U)[:3, 0], printed)
    force = carried_force()
    reaction = [LENGTH1 * force.dot(J1) - V_TIP * force.dot(I1), *(ONE.tip.T * force.dot(J1))]
    missing = sp.Matrix(reaction)
    assert not equal(EXACT[:3, 0], printed)
    assert equal(EXACT[:3, 0], printed + missing)


def test_reaction_and_elbow_acceleration_in_closed_form() -> None:
    acceleration = rate(ELBOW_VELOCITY)
    force = TWO.M4 * acceleration + QDD[3] * (TWO.M3 * J2 - STATIC2 * I2)
    force += (TWO.M2.T * Q2DD)[0] * J2 - RATE2**2 * (TWO.M3 * I2 + STATIC2 * J2)
    force -= 2 * RATE2 * STATIC2_RATE * I2
    assert equal(carried_force(), force)
    bias = -LENGTH1 * RATE1**2 * I1 - 2 * V_TIP_RATE * RATE1 * I1 - V_TIP * RATE1**2 * J1
    at_rest_of_rates = dict.fromkeys(QDD, sp.Integer(0))
    assert equal(acceleration.xreplace(at_rest_of_rates), bias)


def test_26a_lacks_the_theta2_derivative_and_26b_is_right() -> None:
    lacking = STATIC2 * VOY * RATE2 + STATIC2_RATE * VOX + TWO.M3 * VOX * RATE2
    assert equal(EXACT[3], printed_26a(VOX_RATE, VOY_RATE) + lacking)
    assert equal(EXACT[4:6, 0], printed_26b(VOY_RATE))


def test_26_in_acceleration_components() -> None:
    ax, ay = (rate(ELBOW_VELOCITY).dot(axis) for axis in (I2, J2))
    assert equal(ax, VOX_RATE - RATE2 * VOY)
    assert equal(ay, VOY_RATE + RATE2 * VOX)
    # With the printed Vdot as acceleration components both equations have one velocity term too
    # many, too.
    assert equal(EXACT[3], printed_26a(ax, ay) + STATIC2_RATE * VOX)
    assert equal(EXACT[4:6, 0], printed_26b(ay) - TWO.M2 * VOX * RATE2)


def corrected_mass_matrix() -> sp.Matrix:
    reach, offset = LENGTH1 * COS - V_TIP * SIN, LENGTH1 * SIN + V_TIP * COS
    top = ONE.inertia + (Q1.T * ONE.M1 * Q1)[0] + TWO.M4 * (LENGTH1**2 + V_TIP**2)
    m_1q1 = ONE.a + TWO.M4 * LENGTH1 * ONE.tip
    m_12 = sp.Matrix([[TWO.M3 * reach + STATIC2 * offset]])
    m_1q2 = TWO.M2.T * reach
    m_qq = ONE.M1 + TWO.M4 * ONE.tip.T * ONE.tip
    m_q2 = ONE.tip.T * (TWO.M3 * COS + STATIC2 * SIN)
    m_qq2 = ONE.tip.T * TWO.M2.T * COS
    m_22 = sp.Matrix([[TWO.inertia + (Q2.T * TWO.M1 * Q2)[0]]])
    return sp.Matrix(
        sp.BlockMatrix(
            [
                [sp.Matrix([[top]]), m_1q1, m_12, m_1q2],
                [m_1q1.T, m_qq, m_q2, m_qq2],
                [m_12.T, m_q2.T, m_22, TWO.a],
                [m_1q2.T, m_qq2.T, TWO.a.T, TWO.M1],
            ]
        )
    )


def test_mass_matrix_of_27() -> None:
    """The printed one is block diagonal; with Vdot_o written out it is not even symmetric."""
    corrected = corrected_mass_matrix()
    assert equal(sp.hessian(T1 + T2, list(QD)), corrected)
    assert equal(EXACT.jacobian(QDD), corrected)
    lines = [*printed_24_25(), printed_26a(VOX_RATE, VOY_RATE), *printed_26b(VOY_RATE)]
    implied = sp.Matrix(lines).jacobian(QDD)
    assert equal(implied[:3, 3:], sp.zeros(3, 3))
    assert equal(implied[3:, :], corrected[3:, :])
    assert not equal(implied, implied.T)
