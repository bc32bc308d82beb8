"""D0, D1 and G in use: spinning, hanging, standing and compressed links."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import eigvalsh

from beam_links import flexible_link

REFERENCE = json.loads(
    (Path(__file__).parents[2] / "data" / "beam_reference.json").read_text(encoding="utf-8")
)
ELEMENTS = 32
# Third mode: mesh error (beta h)^4/1440 = 2.5e-6.
MESH = 3e-6


@pytest.fixture(scope="module")
def link():
    one, zero = np.ones(2), np.zeros(2)
    return flexible_link([0.0, 1.0], one, one, zero, elements=ELEMENTS)


def frequencies(stiffness):
    return np.sqrt(eigvalsh(stiffness)[:3])


@pytest.mark.parametrize("case", REFERENCE["rotating"], ids=lambda case: f"gamma={case['gamma']}")
def test_spinning_link(link, case):
    """In the plane of rotation w^2 (D1 - 1) is added to the stiffness, out of it w^2 D1."""
    stiffened = np.diag(link.w2) + case["gamma"] ** 2 * link.D1
    lag = stiffened - case["gamma"] ** 2 * np.eye(link.w2.size)
    np.testing.assert_allclose(frequencies(stiffened), case["flap"][:3], rtol=MESH)
    np.testing.assert_allclose(frequencies(lag), case["lag"][:3], rtol=MESH)


@pytest.mark.parametrize(
    "case", REFERENCE["own_weight"]["hanging"], ids=lambda case: f"weight={case['weight']}"
)
def test_link_hanging_under_its_own_weight(link, case):
    found = frequencies(np.diag(link.w2) + case["weight"] * link.D0)
    np.testing.assert_allclose(found, case["lambda"], rtol=MESH)


def buckling(link, geometric):
    """Return the lowest load at which diag(w2) - load * geometric becomes indefinite."""
    return 1.0 / eigvalsh(geometric / np.sqrt(np.outer(link.w2, link.w2)))[-1]


def test_standing_link_buckles_at_greenhills_weight(link):
    # Mesh error of the critical load, (2 h)^4/720 in order of magnitude.
    assert buckling(link, link.D0) == pytest.approx(REFERENCE["own_weight"]["buckling"], rel=1e-7)


def test_compressed_link_buckles_at_eulers_load(link):
    assert buckling(link, link.G) == pytest.approx(np.pi**2 / 4, rel=1e-7)
