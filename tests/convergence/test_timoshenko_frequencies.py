"""Frequencies of links with shear against Timoshenko's equations, and convergence of meshes.

Uniform beams with L = EI = mu = 1: rotary inertia 1/slenderness^2, shear stiffness
slenderness^2/3.12 (shear coefficient 5/6, Poisson's ratio 0.3).
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from scipy.optimize import brentq
from shooting import shooting_root

import flexarm as fa
from beam_links import flexible_link

CASES = json.loads(
    (Path(__file__).parents[1] / "data" / "beam_reference.json").read_text(encoding="utf-8")
)["timoshenko"]
CLAMPED = [case for case in CASES if case["root"] == "clamped"]
SHEAR = 3.12


def label(case):
    return f"{case['root']} L/r={case['slenderness']:g}"


def characteristic(lam, slenderness, root):
    """Return the determinant of the four boundary conditions at frequencies lam (k,).

    k (v'' - phi') + lam^2 v = 0 and phi'' + k (v' - phi) + (lam r)^2 phi = 0 have, below the
    frequency slenderness^2/sqrt(3.12), solutions v = exp(p (x - 1)), exp(-p x), cos(q x), sin(q x),
    with phi = v' + (lam^2/k) * (integral of v).
    """
    lam = np.asarray(lam, float)
    rotary, shear = (lam / slenderness) ** 2, SHEAR * (lam / slenderness) ** 2
    middle = (rotary + shear) / 2
    root_of = np.sqrt(middle**2 + lam**2 - rotary * shear)
    p, q = np.sqrt(root_of - middle), np.sqrt(root_of + middle)

    def derivatives(x, order):
        """Return derivatives of the four functions or, at order -1, their integrals."""
        turn = order * np.pi / 2
        return np.stack(
            [
                p**order * np.exp(p * (x - 1)),
                (-1.0) ** order * p**order * np.exp(-p * x),
                q**order * np.cos(q * x + turn),
                q**order * np.sin(q * x + turn),
            ],
            axis=-1,
        )

    def rotation(x, order):
        return derivatives(x, order + 1) + shear[..., None] * derivatives(x, order - 1)

    conditions = [
        derivatives(0, 0),
        rotation(0, 0 if root == "clamped" else 1),
        rotation(1, 1),
        derivatives(1, 1) - rotation(1, 0),
    ]
    rows = [row / np.linalg.norm(row, axis=-1, keepdims=True) for row in conditions]
    return np.linalg.det(np.stack(rows, axis=-2))


def exact_lambda(slenderness, root, highest):
    """Return all frequencies up to a largest one."""
    beta = np.linspace(0.05, np.sqrt(highest) * 1.02, 3000)
    brackets = np.flatnonzero(np.diff(np.sign(characteristic(beta**2, slenderness, root))))
    roots = [
        brentq(
            lambda b: characteristic(b**2, slenderness, root),
            beta[k],
            beta[k + 1],
            xtol=1e-14,
            rtol=1e-14,
        )
        for k in brackets
    ]
    return np.square(roots)


@cache
def uniform(elements, slenderness):
    two = np.ones(2)
    return flexible_link(
        [0.0, 1.0],
        two,
        two,
        two / slenderness**2,
        elements=elements,
        shear_rigidity=two * slenderness**2 / SHEAR,
    )


def mesh_lambda(case, elements, count=3):
    """Return the lowest frequencies of the finite element model."""
    link = uniform(elements, case["slenderness"])
    if case["root"] == "clamped":
        return np.sqrt(link.w2[:count])
    m = link.w2.size
    inertia = np.eye(m + 1)
    inertia[0, 0] = link.inertia
    inertia[0, 1:] = inertia[1:, 0] = link.a
    stiffness = np.diag(np.append(0.0, link.w2))
    # The shift keeps the free rotation, the largest eigenvalue, finite.
    inverse = eigvalsh(inertia, stiffness + inertia)[::-1][1 : 1 + count]
    return np.sqrt(1.0 / inverse - 1.0)


def bending_error(lam, elements):
    """Return the relative error (B.25) of an Euler-Bernoulli beam of the same mesh, in leading
    order."""
    return lam**2 / elements**4 / 1440


@pytest.mark.parametrize("case", CASES, ids=label)
def test_reference_numbers_are_all_roots_in_order(case):
    found = exact_lambda(case["slenderness"], case["root"], case["lambda"][-1])
    # Thirteen digits are printed; squaring beta L and the determinant add rounding.
    np.testing.assert_allclose(found[: len(case["lambda"])], case["lambda"], rtol=5e-12)


@pytest.mark.parametrize("joints", ["locked", "free"])
@pytest.mark.parametrize("slenderness", [10.0, 100.0, 200.0])
def test_modes_of_an_arm_of_one_link(slenderness, joints):
    """A locked joint clamps the link; a free one hinges it and adds a free rotation."""
    link = fa.Link(
        length=1.0,
        flexural_rigidity=1.0,
        mass_per_length=1.0,
        rotary_inertia_per_length=slenderness**-2,
        shear_rigidity=slenderness**2 / SHEAR,
        element="timoshenko",
        elements=48,
    )
    root = "clamped" if joints == "locked" else "pinned"
    (case,) = [c for c in CASES if c["root"] == root and c["slenderness"] == slenderness]
    rigid = 0 if joints == "locked" else 1
    found = 2 * np.pi * fa.modes(fa.Arm(links=[link]), joints=joints).frequency_hz[rigid:]
    exact = np.array(case["lambda"])
    error = found[: exact.size] / exact - 1
    assert np.all(error > 0.0)  # finite elements give upper bounds
    # The fourth mode with much shear has the largest error; a constant shear angle gave 60 to 500
    # times as much.
    assert np.all(error < 8.0 * bending_error(exact, 48))


@pytest.mark.thorough
@pytest.mark.parametrize("case", CLAMPED, ids=label)
def test_error_approaches_that_of_an_euler_bernoulli_beam(case):
    exact = np.array(case["lambda"][:3])
    ratio = (mesh_lambda(case, 96) / exact - 1) / bending_error(exact, 96)
    # The mean acceleration of an element replaces its linear course.
    assert np.all((ratio > 0.9) & (ratio < 4.0)), ratio


@pytest.mark.sampled(
    "3.0-4.8-clamped",
    "10.0-48.0-clamped",
    "30.0-105.0-clamped",
    "100.0-105.0-pinned",
    "1000.0-105.0-pinned",
    "5000.0-105.0-pinned",
)
@pytest.mark.parametrize("root", ["clamped", "pinned"])
@pytest.mark.parametrize(
    ("slenderness", "highest"),
    [(3.0, 4.8), (10.0, 48.0), (30.0, 105.0), (100.0, 105.0), (1000.0, 105.0), (5000.0, 105.0)],
)
def test_order_is_four_for_every_thickness(slenderness, highest, root):
    case = {"root": root, "slenderness": slenderness}
    exact = exact_lambda(slenderness, root, highest)[:3]
    counts = np.array([12, 16, 24, 32])
    errors = np.array([mesh_lambda(case, int(n), exact.size) / exact - 1 for n in counts])
    assert np.all(errors > 0.0)
    orders = -np.polyfit(np.log(counts), np.log(errors), 1)[0]
    # Next orders in h: above, of the end elements; below, of the third mode.
    assert np.all((orders > 3.85) & (orders < 4.8)), orders


def test_arms_of_two_stocky_links_have_order_four():
    """The root of the second link moves, and the first one carries it; with reduced shapes and with
    all."""

    def frequencies(elements, modes=None):
        link = fa.Link(
            length=1.0,
            flexural_rigidity=1.0,
            mass_per_length=1.0,
            rotary_inertia_per_length=0.01,
            shear_rigidity=100 / SHEAR,
            element="timoshenko",
            elements=elements,
            modes=modes,
        )
        arm = fa.Arm(links=[link, link], joints=[fa.Joint(stiffness=2.0)] * 2)
        return fa.modes(arm, [0.0, 1.0]).frequency_hz[:4]

    finest = frequencies(48)
    errors = np.array([frequencies(n) / finest - 1 for n in (6, 12, 24)])
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 3.8)
    reduced = frequencies(24, modes=8) / finest - 1
    assert np.all((reduced > 0.0) & (reduced < 1e-3))  # omitted shapes


@pytest.mark.thorough
def test_without_rotary_inertia_the_order_is_two():
    """A rotation without inertia has no mass; see ``beams.interior``."""
    two = np.ones(2)

    def lowest(elements):
        shear = two * 100 / SHEAR
        beam = flexible_link([0, 1], two, two, 0 * two, elements=elements, shear_rigidity=shear)
        return np.sqrt(beam.w2[:3])

    errors = np.array([lowest(n) / lowest(96) - 1 for n in (8, 16)])
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 2.0, atol=0.15)


@pytest.mark.parametrize("slenderness", [1e3, 1e4, 1e6])
@pytest.mark.parametrize("elements", [1, 2, 4])
def test_slender_links_do_not_lock_on_coarse_meshes(slenderness, elements):
    """Elements that lock are too stiff by a factor of the order of slenderness^2/elements^2."""
    two = np.ones(2)
    bending = np.sqrt(flexible_link([0, 1], two, two, 0 * two, elements=elements).w2[:2])
    found = np.sqrt(uniform(elements, slenderness).w2[:2])
    # Shear and rotary inertia lower the first two frequencies of the exact solution by 9.6 and 66.5
    # over slenderness^2, those of one element by 8.7 and 43.7.
    lowered = (1 - found / bending) * slenderness**2
    rounding = 1e-13 * slenderness**2
    np.testing.assert_allclose(lowered[0], 9.6, rtol=0.1, atol=rounding)
    np.testing.assert_allclose(lowered[1], 66.5, rtol=0.35, atol=rounding)


def tapered_root(x, columns, guess):
    """Return the frequency near `guess` of a clamped tapered beam."""

    def slope(s, y, square):
        v, turn, moment, force = y[0::4], y[1::4], y[2::4], y[3::4]
        rigidity, mass, rotary, shear = (np.interp(s, x, column) for column in columns)
        # EI phi' = M, k G A (v' - phi) = Q, M' + Q = -w^2 rho I phi, Q' = -w^2 mu v
        return np.stack(
            [
                turn + force / shear,
                moment / rigidity,
                -force - square * rotary * turn,
                -square * mass * v,
            ],
            axis=1,
        ).ravel()

    return shooting_root(slope, x, guess)


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("x", "columns"),
    [
        ([0.0, 1.0], ([2.0, 0.25], [1.5, 0.5], [0.02, 0.004], [40.0, 9.0])),
        (
            [0.0, 0.25, 0.5, 1.0],
            ([4.0, 1.0, 2.0, 0.5], [1.0, 2.0, 0.3, 0.8], [0.0, 0.03, 0.01, 0.0], [90, 30, 60, 10]),
        ),
    ],
    ids=["linear taper", "kinked table"],
)
def test_tapered_beams_converge_to_an_independent_integration(x, columns):
    found = [
        np.sqrt(flexible_link(x, *columns[:3], elements=n, shear_rigidity=columns[3]).w2[:3])
        for n in (16, 32)
    ]
    exact = np.array([tapered_root(np.array(x), columns, w) for w in found[-1]])
    errors = np.array(found) / exact - 1
    assert np.all(errors > 0.0)
    orders = np.log2(errors[0] / errors[1])
    assert np.all((orders > 3.7) & (orders < 4.8)), orders
    assert np.all(errors[1] < 1e-5)
