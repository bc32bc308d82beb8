"""The flexible two-link arm of the linear theory with its matrices written out by hand.

Uniform links, no lumped inertia, horizontal plane. Absolute root angles t1, t2, b = t1 - t2,
c = cos b, s = sin b; ve = Ne q1 and N'e q1 are deflection and slope of link 1's tip; M_i, K_i, S_i,
a_i the nodal matrices of link i, m its mass, mc = m L / 2, I = m L^2 / 3. Kinetic energy of both
links gives

    M(t1,t1) = I1 + q1 M1 q1 + m2 (L1^2 + ve^2)      M(t1,q1) = a1 + m2 L1 Ne
    M(t1,t2) = mc2 (L1 c - ve s) + (S2 q2) (L1 s + ve c)
    M(t1,q2) = S2 (L1 c - ve s)                      M(q1,q1) = M1 + m2 Ne Ne'
    M(q1,t2) = Ne [mc2 c + (S2 q2) s]                M(q1,q2) = Ne S2' c
    M(t2,t2) = I2 + q2 M2 q2                         M(t2,q2) = a2      M(q2,q2) = M2

and, with i_k, j_k the body axes of link k, A the velocity-dependent part of the elbow's
acceleration and F that of the force link 1 gives link 2,

    A = -L1 t1'^2 i1 - 2 ve' t1' i1 - ve t1'^2 j1
    F = m2 A - t2'^2 (mc2 i2 + (S2 q2) j2) - 2 t2' (S2 q2') i2
    bias(t1) = 2 (q1 M1 q1') t1' + L1 (F.j1) - ve (F.i1)
    bias(q1) = K1 q1 - t1'^2 M1 q1 + Ne (F.j1)
    bias(t2) = 2 (q2 M2 q2') t2' - (S2 q2) (A.i2) + mc2 (A.j2)
    bias(q2) = K2 q2 - t2'^2 M2 q2 + S2 (A.j2)

Relative angles: t2 = t1 + N'e q1 + theta2, a constant matrix T, hence T' M T and T' bias.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from .textbook_beam import textbook_beam


def two_link_closed_form(
    lengths: tuple[float, float],
    flexural_rigidities: tuple[float, float],
    masses_per_length: tuple[float, float],
    elements: tuple[int, int],
    q: Any,
    qd: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """Return mass matrix and bias force at q = [theta1, nodal 1, theta2, nodal 2], relative
    angles."""
    link1, link2 = (
        textbook_beam(*arguments)
        for arguments in zip(lengths, flexural_rigidities, masses_per_length, elements, strict=True)
    )
    n1, n2 = 2 * elements[0], 2 * elements[1]
    t1, q1, t2, q2 = 0, slice(1, 1 + n1), 1 + n1, slice(2 + n1, 2 + n1 + n2)
    to_absolute = np.eye(2 + n1 + n2)
    to_absolute[t2, t1] = to_absolute[t2, n1] = 1.0  # n1: index of the slope at link 1's tip
    p, pd = to_absolute @ q, to_absolute @ qd

    length, m2 = lengths[0], masses_per_length[1] * lengths[1]
    inertia1 = masses_per_length[0] * lengths[0] ** 3 / 3
    inertia2 = masses_per_length[1] * lengths[1] ** 3 / 3
    mc2 = m2 * lengths[1] / 2
    tip = np.zeros(n1)
    tip[-2] = 1.0
    ve, ved = tip @ p[q1], tip @ pd[q1]
    s2q, s2qd = link2.first @ p[q2], link2.first @ pd[q2]
    c, s = np.cos(p[t1] - p[t2]), np.sin(p[t1] - p[t2])

    mass = np.zeros_like(to_absolute)
    mass[t1, t1] = inertia1 + p[q1] @ link1.mass @ p[q1] + m2 * (length**2 + ve**2)
    mass[t1, q1] = link1.moment + m2 * length * tip
    mass[t1, t2] = mc2 * (length * c - ve * s) + s2q * (length * s + ve * c)
    mass[t1, q2] = link2.first * (length * c - ve * s)
    mass[q1, q1] = link1.mass + m2 * np.outer(tip, tip)
    mass[q1, t2] = tip * (mc2 * c + s2q * s)
    mass[q1, q2] = np.outer(tip, link2.first) * c
    mass[t2, t2] = inertia2 + p[q2] @ link2.mass @ p[q2]
    mass[t2, q2] = link2.moment
    mass[q2, q2] = link2.mass
    mass = np.triu(mass) + np.triu(mass, 1).T

    w1, w2 = pd[t1], pd[t2]
    i1, j1 = unit(p[t1]), unit(p[t1] + np.pi / 2)
    i2, j2 = unit(p[t2]), unit(p[t2] + np.pi / 2)
    elbow = -(length * w1**2 + 2 * ved * w1) * i1 - ve * w1**2 * j1
    force = m2 * elbow - w2**2 * (mc2 * i2 + s2q * j2) - 2 * w2 * s2qd * i2
    bias = np.zeros_like(p)
    bias[t1] = 2 * (p[q1] @ link1.mass @ pd[q1]) * w1 + length * (force @ j1) - ve * (force @ i1)
    bias[q1] = (link1.stiffness - w1**2 * link1.mass) @ p[q1] + tip * (force @ j1)
    bias[t2] = 2 * (p[q2] @ link2.mass @ pd[q2]) * w2 - s2q * (elbow @ i2) + mc2 * (elbow @ j2)
    bias[q2] = (link2.stiffness - w2**2 * link2.mass) @ p[q2] + link2.first * (elbow @ j2)
    return to_absolute.T @ mass @ to_absolute, to_absolute.T @ bias


def unit(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])
