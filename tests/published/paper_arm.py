"""The paper's two-link arm as symbols, and Lagrange's equations for it, in exact arithmetic.

Two polynomial shape functions on each link stand for the finite elements: the algebra does not
depend on which shapes they are. "Equal" means a difference of zero at random rational states, so
it needs no tolerance; a symbolic simplification would only be slower.

Notation of the paper: theta_i absolute angles, v = N(x) q with N a row, V_o the elbow's velocity
in the axes of link 2, M1 = int mu N^T N, M2 = int mu N^T (a column), M3 = int mu x, M4 = int mu,
I = int mu x^2, a = int mu x N (a row).
"""

import random

import sympy as sp
from sympy.core.expr import Expr

X = sp.Symbol("x")
ZERO = sp.Integer(0)
Q = sp.Matrix(sp.symbols("theta_1 q_11 q_12 theta_2 q_21 q_22"))
QD = sp.Matrix(sp.symbols("dtheta_1 dq_11 dq_12 dtheta_2 dq_21 dq_22"))
QDD = sp.Matrix(sp.symbols("ddtheta_1 ddq_11 ddq_12 ddtheta_2 ddq_21 ddq_22"))
THETA1, THETA2 = Q[0], Q[3]
RATE1, RATE2 = QD[0], QD[3]
Q1, Q2 = Q[1:3, 0], Q[4:6, 0]
Q1D, Q2D = QD[1:3, 0], QD[4:6, 0]
Q1DD, Q2DD = QDD[1:3, 0], QDD[4:6, 0]

N = sp.Matrix([[X**2, X**3]])  # clamped at x = 0: one Hermite element spans the same space
LENGTH1, LENGTH2 = sp.Rational(7, 5), sp.Integer(1)
MU1, MU2 = sp.Rational(3, 5), sp.Rational(4, 7)
RIGIDITY1, RIGIDITY2 = sp.Integer(3), sp.Integer(2)
TRIPLES = ((3, 4, 5), (5, 12, 13), (8, 15, 17), (7, 24, 25))


def integral(integrand: Expr, start: Expr, end: Expr) -> Expr:
    """Definite integral over x of a polynomial in x."""
    antiderivative = sp.Poly(sp.expand(integrand), X).integrate()
    return antiderivative.eval(end) - antiderivative.eval(start)


def along(matrix: sp.Matrix, length: Expr) -> sp.Matrix:
    return matrix.applyfunc(lambda entry: integral(entry, 0, length))


class Link:
    """The paper's integrals of one link."""

    def __init__(self, mu: Expr, rigidity: Expr, length: Expr) -> None:
        slope = N.diff(X)
        curvature = slope.diff(X)
        self.length = length
        self.M1 = along(mu * N.T * N, length)
        self.M2 = along(mu * N.T, length)
        self.M3, self.M4 = mu * length**2 / 2, mu * length
        self.inertia = mu * length**3 / 3
        self.a = along(mu * X * N, length)
        self.K = along(rigidity * curvature.T * curvature, length)
        self.tip, self.tip_slope = N.subs(X, length), slope.subs(X, length)


ONE, TWO = Link(MU1, RIGIDITY1, LENGTH1), Link(MU2, RIGIDITY2, LENGTH2)
V_TIP, V_TIP_RATE = (ONE.tip * Q1)[0], (ONE.tip * Q1D)[0]
STATIC2, STATIC2_RATE = (TWO.M2.T * Q2)[0], (TWO.M2.T * Q2D)[0]
COS = sp.cos(THETA1) * sp.cos(THETA2) + sp.sin(THETA1) * sp.sin(THETA2)  # of theta1 - theta2
SIN = sp.sin(THETA1) * sp.cos(THETA2) - sp.cos(THETA1) * sp.sin(THETA2)


def axes(angle: Expr) -> tuple[sp.Matrix, sp.Matrix]:
    c, s = sp.cos(angle), sp.sin(angle)
    return sp.Matrix([c, s]), sp.Matrix([-s, c])


I1, J1 = axes(THETA1)
I2, J2 = axes(THETA2)
ELBOW = LENGTH1 * I1 + V_TIP * J1
R1 = X * I1 + (N * Q1)[0] * J1
R2 = ELBOW + X * I2 + (N * Q2)[0] * J2


def rate(expression):
    """Time derivative of a scalar or a matrix of scalars."""
    if isinstance(expression, sp.MatrixBase):
        return expression.applyfunc(rate)
    total = ZERO
    for q, qd, qdd in zip(Q, QD, QDD, strict=True):
        total += expression.diff(q) * qd + expression.diff(qd) * qdd
    return total


def kinetic(position: sp.Matrix, mu: Expr, length: Expr) -> Expr:
    velocity = rate(position)
    return integral(mu * velocity.dot(velocity) / 2, 0, length)


def lagrange(kinetic_energy: Expr, potential: Expr = ZERO) -> sp.Matrix:
    """d/dt dT/dqd - dT/dq + dU/dq for all six coordinates."""
    return sp.Matrix(
        [
            rate(kinetic_energy.diff(qd)) - (kinetic_energy - potential).diff(q)
            for q, qd in zip(Q, QD, strict=True)
        ]
    )


T1, T2 = kinetic(R1, MU1, LENGTH1), kinetic(R2, MU2, LENGTH2)
U = ((Q1.T * ONE.K * Q1 + Q2.T * TWO.K * Q2) / 2)[0]
EXACT = lagrange(T1 + T2, U)
ELBOW_VELOCITY = rate(ELBOW)
VOX, VOY = ELBOW_VELOCITY.dot(I2), ELBOW_VELOCITY.dot(J2)
VOX_RATE, VOY_RATE = rate(VOX), rate(VOY)


def random_state(seed: int) -> dict[Expr, Expr]:
    generator = random.Random(seed)
    values: dict[Expr, Expr] = {}
    for angle in (THETA1, THETA2):
        a, b, c = generator.choice(TRIPLES)
        values[sp.cos(angle)] = sp.Rational(a, c)
        values[sp.sin(angle)] = sp.Rational(generator.choice((-b, b)), c)
    for symbol in (*Q, *QD, *QDD):
        values[symbol] = sp.Rational(generator.choice((-1, 1)) * generator.randint(1, 30), 11)
    return values


def value(expression, seed: int):
    state = random_state(seed) | {X: sp.Rational(seed, 7)}
    if isinstance(expression, sp.MatrixBase):
        return expression.applyfunc(lambda entry: sp.sympify(entry).xreplace(state))
    return sp.sympify(expression).xreplace(state)


def equal(left, right) -> bool:
    """Return whether expressions are equal at three random states, in exact arithmetic."""
    difference = sp.Matrix([left]) - sp.Matrix([right])
    return all(value(difference, seed).is_zero_matrix for seed in (1, 2, 3))


def carried_force() -> sp.Matrix:
    """Return the rate of momentum of link 2 by Newton's law, the force of link 1 at the elbow."""
    return rate(rate(along(MU2 * R2, LENGTH2)))
