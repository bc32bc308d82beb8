"""Frequencies of beams against their characteristic equations, and convergence of meshes.

Uniform beams with L = EI = mu = 1: a frequency is lambda = (beta L)^2.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvalsh
from scipy.optimize import brentq
from shooting import shooting_root

from beam_links import flexible_link

REFERENCE = json.loads(
    (Path(__file__).parents[1] / "data" / "beam_reference.json").read_text(encoding="utf-8")
)
CLAMPED = [{"root": "clamped", **case} for case in REFERENCE["clamped"]]
PINNED = [{"root": "pinned", **case} for case in REFERENCE["pinned"]]
RAYLEIGH = REFERENCE["rayleigh"]
EVERY = [*CLAMPED, *PINNED, *RAYLEIGH]


def label(case):
    return " ".join(f"{key}={value}" for key, value in case.items() if not isinstance(value, list))


def exact_lambda(case):
    return np.asarray(case["lambda"]) if "lambda" in case else np.asarray(case["beta_L"]) ** 2


def characteristic(lam, case):
    """Return the determinant of the four boundary conditions at frequencies lam (k,).

    y'''' + (lam r)^2 y'' - lam^2 y = 0 with r = 1/slenderness has the solutions exp(p (x - 1)),
    exp(-p x), cos(q x), sin(q x), none of them large in (0, 1).
    """
    lam = np.asarray(lam, float)
    rotary = (lam / case.get("slenderness", np.inf)) ** 2
    root = np.sqrt(rotary**2 / 4 + lam**2)
    p, q = np.sqrt(root - rotary / 2), np.sqrt(root + rotary / 2)

    def derivatives(x, order):
        turn = order * np.pi / 2
        return np.stack(
            [
                p**order * np.exp(p * (x - 1)),
                (-p) ** order * np.exp(-p * x),
                q**order * np.cos(q * x + turn),
                q**order * np.sin(q * x + turn),
            ],
            axis=-1,
        )

    inertia = lam[..., None] ** 2
    hub, mass, tip = (case.get(name, 0.0) for name in ("hub", "tip_mass", "tip_inertia"))
    turning = derivatives(0, 1)
    if case["root"] == "pinned":
        turning = derivatives(0, 2) + hub * inertia * derivatives(0, 1)
    conditions = [
        derivatives(0, 0),
        turning,
        derivatives(1, 2) - tip * inertia * derivatives(1, 1),
        derivatives(1, 3)
        + rotary[..., None] * derivatives(1, 1)
        + mass * inertia * derivatives(1, 0),
    ]
    rows = [row / np.linalg.norm(row, axis=-1, keepdims=True) for row in conditions]
    return np.linalg.det(np.stack(rows, axis=-2))


@cache
def uniform(elements, modes, slenderness):
    two = np.ones(2)
    rotary = two / slenderness**2
    return flexible_link([0.0, 1.0], two, two, rotary, elements=elements, modes=modes)


def mesh_lambda(case, elements, count=3, modes=None):
    """Return the lowest frequencies of a finite element model with hub, tip mass and tip
    inertia."""
    link = uniform(elements, modes, case.get("slenderness", np.inf))
    hub, mass, tip = (case.get(name, 0.0) for name in ("hub", "tip_mass", "tip_inertia"))
    m = link.w2.size
    inertia = np.eye(m + 1)
    inertia[0, 0] = link.inertia + hub
    inertia[0, 1:] = inertia[1:, 0] = link.a
    moved, turned = np.append(1.0, link.P), np.append(1.0, link.dP)
    inertia += mass * np.outer(moved, moved) + tip * np.outer(turned, turned)
    stiffness = np.diag(np.append(0.0, link.w2))
    rigid = 1
    if case["root"] == "clamped":
        inertia, stiffness, rigid = inertia[1:, 1:], stiffness[1:, 1:], 0
    # The lowest frequencies are the largest eigenvalues of the inverse problem, which are accurate.
    # The shift keeps the free rotation, which has no stiffness, finite.
    inverse = eigvalsh(inertia, stiffness + inertia)[::-1][rigid : rigid + count]
    return np.sqrt(1.0 / inverse - 1.0)


@pytest.mark.parametrize("case", EVERY, ids=label)
def test_reference_numbers_are_all_roots_in_order(case):
    reference = exact_lambda(case)
    beta = np.linspace(0.05, np.sqrt(reference[-1]) * 1.02, 3000)
    sign = np.sign(characteristic(beta**2, case))
    brackets = np.flatnonzero(np.diff(sign))
    roots = [
        brentq(lambda b: characteristic(b**2, case), beta[k], beta[k + 1], xtol=1e-14, rtol=1e-14)
        for k in brackets
    ]
    found = np.square(roots[: reference.size])
    # Thirteen digits are printed; squaring beta L and the determinant add rounding.
    np.testing.assert_allclose(found, reference, rtol=5e-12)


@pytest.mark.parametrize("elements", [1, 2])
def test_coarse_meshes_to_all_printed_digits(elements):
    printed = REFERENCE["hermite_mesh"][str(elements)]
    found = mesh_lambda({"root": "clamped"}, elements, count=2 * elements)
    np.testing.assert_allclose(found, printed, rtol=0.0, atol=0.51e-10)
    if elements == 1:
        exact = np.sqrt(612 + 96 * np.sqrt(39) * np.array([-1, 1]))
        np.testing.assert_allclose(found, exact, rtol=1e-12)  # 612 - 96 sqrt(39) cancels


@pytest.mark.sampled(
    "root=clamped tip_mass=0.0 tip_inertia=0.0",
    "root=clamped tip_mass=10.0 tip_inertia=0.0",
    "root=pinned hub=0.0 tip_mass=0.0 tip_inertia=0.0",
    "root=pinned hub=100.0 tip_mass=0.0 tip_inertia=0.0",
    "root=pinned hub=1.0 tip_mass=1.0 tip_inertia=0.1",
    "root=pinned slenderness=200.0",
)
@pytest.mark.parametrize("case", EVERY, ids=label)
def test_error_falls_with_the_fourth_power_of_the_element_length(case):
    exact = exact_lambda(case)[:3]
    counts = np.array([12, 16, 24, 32])
    errors = np.array([mesh_lambda(case, int(n)) / exact - 1 for n in counts])
    assert np.all(errors > 0.0)  # finite elements give upper bounds
    # With a heavy tip the first mode is almost static: its error is below the last printed digit.
    seen = errors[-1] > 1e-10
    assert np.all(seen[1:])
    orders = -np.polyfit(np.log(counts), np.log(errors[:, seen]), 1)[0]
    # the next order is visible at the third mode
    np.testing.assert_allclose(orders, 4.0, atol=0.06)


@pytest.mark.sampled("root=clamped tip_mass=0.5 tip_inertia=0.1", "root=pinned slenderness=100.0")
@pytest.mark.parametrize("case", EVERY, ids=label)
def test_first_three_frequencies_are_accurate_to_1e_minus_6_with_56_elements(case):
    exact = exact_lambda(case)[:3]
    np.testing.assert_allclose(mesh_lambda(case, 56), exact, rtol=1e-6)


@pytest.mark.parametrize("case", [*CLAMPED, *PINNED], ids=label)
def test_error_has_the_theoretical_size(case):
    """(beta h)^4/1440, times the share of the distributed mass in the kinetic energy."""
    elements = 16
    exact = exact_lambda(case)[:3]
    error = mesh_lambda(case, elements) / exact - 1
    bound = (np.sqrt(exact) / elements) ** 4 / 1440
    assert np.all(error < 1.02 * bound)  # the next order is (beta h)^2/20 at the third mode
    if not any(case.get(name, 0.0) for name in ("hub", "tip_mass", "tip_inertia")):
        np.testing.assert_allclose(error, bound, rtol=0.03)


@pytest.mark.parametrize("case", REFERENCE["de_luca_siciliano"], ids=lambda c: f"link {c['link']}")
def test_published_link_modes(case):
    mass = case["mass_per_length"] * case["length"]
    scaled = {
        "root": "clamped",
        "tip_mass": case["tip_mass"] / mass,
        "tip_inertia": case["tip_inertia"] / (mass * case["length"] ** 2),
    }
    unit = np.sqrt(case["flexural_rigidity"] / (case["mass_per_length"] * case["length"] ** 4))
    hertz = mesh_lambda(scaled, 32, count=2) * unit / (2 * np.pi)
    np.testing.assert_allclose(hertz, case["exact_hz"], rtol=1e-7)  # mesh error of mode two
    np.testing.assert_allclose(hertz, case["published_hz"], rtol=0.0, atol=0.0051)


@pytest.mark.parametrize("case", PINNED[:7], ids=label)
def test_clamped_and_hub_frequencies_interlace(case):
    clamped = mesh_lambda({"root": "clamped"}, 16, count=4)
    hub = mesh_lambda(case, 16, count=3)
    assert np.all((clamped[:3] < hub) & (hub < clamped[1:]))


@pytest.mark.parametrize("case", [PINNED[3], PINNED[11], CLAMPED[9]], ids=label)
def test_four_reduced_shapes_give_the_lowest_loaded_frequencies(case):
    full, reduced = mesh_lambda(case, 16, 2), mesh_lambda(case, 16, 2, modes=4)
    assert np.all(reduced >= full * (1 - 1e-12))  # Rayleigh's principle, up to rounding
    np.testing.assert_allclose(reduced, full, rtol=2e-3)


def tapered_root(x, stiffness, mass, guess):
    """Return the frequency near `guess` of a clamped tapered beam."""

    def slope(s, y, square):
        v, turn, moment, shear = y[0::4], y[1::4], y[2::4], y[3::4]
        rigidity, density = np.interp(s, x, stiffness), np.interp(s, x, mass)
        # EI v'' = M, M' = V, V' = w^2 mu v
        return np.stack([turn, moment / rigidity, shear, square * density * v], axis=1).ravel()

    return shooting_root(slope, x, guess)


@pytest.mark.parametrize(
    ("x", "stiffness", "mass"),
    [
        ([0.0, 1.0], [2.0, 0.25], [1.5, 0.5]),
        ([0.0, 0.25, 0.5, 1.0], [4.0, 1.0, 2.0, 0.5], [1.0, 2.0, 0.3, 0.8]),
    ],
    ids=["linear taper", "kinked table"],
)
def test_tapered_beams_converge_to_an_independent_integration(x, stiffness, mass):
    found = []
    for elements in (32, 64):
        link = flexible_link(x, stiffness, mass, np.zeros(len(x)), elements=elements)
        found.append(np.sqrt(link.w2[:3]))
    exact = np.array([tapered_root(np.array(x), stiffness, mass, w) for w in found[-1]])
    errors = np.array(found) / exact - 1
    # Strong tapers approach the order slowly: the lowest value here is 3.92.
    np.testing.assert_allclose(np.log2(errors[0] / errors[1]), 4.0, atol=0.1)
    assert np.all(errors[1] < 1e-6)
