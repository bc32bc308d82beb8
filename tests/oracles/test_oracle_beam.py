"""One flexible link: matrices, frequencies, damping, spinning and hanging beams."""

import numpy as np
import pytest
import scipy.linalg

from flexarm.model import (
    ArmSpec,
    Joint,
    Link,
    ModalDamping,
    Payload,
    RayleighDamping,
    SectionTable,
)

from .lagrangian import LagrangianOracle
from .textbook_beam import textbook_beam

ROUNDING = 1e-12  # sums of a few dozen products, with little cancellation


def cantilever(elements, **options):
    """Return a uniform link with L = EI = mu = 1, whose frequencies are (beta L)^2."""
    return Link(
        length=1.0, flexural_rigidity=1.0, mass_per_length=1.0, elements=elements, **options
    )


def quick(spec):
    """Return the oracle in float64, for whole meshes and for checks of at most ten digits."""
    return LagrangianOracle(spec, precision=np.float64)


def clamped_frequencies(oracle):
    """Return frequencies (rad/s) of a one-link arm with its joint locked, from M and K at rest."""
    mass = oracle.mass_matrix(np.zeros(oracle.dof))[1:, 1:]
    return np.sqrt(scipy.linalg.eigh(bending_stiffness(oracle, 0.0), mass, eigvals_only=True))


def bending_stiffness(oracle, rate):
    """Return d(bias)/d(bending) at the straight link turning at ``rate`` rad/s.

    In the linear theory the bias force of a single link is linear in its bending. The
    further terms of the second-order one are cubic, which vanish for small displacements.
    """
    small = 1e-5
    qd = np.zeros(oracle.dof)
    qd[0] = rate
    straight = oracle.bias_force(np.zeros(oracle.dof), qd)
    units = small * np.eye(oracle.dof)[1:]
    columns = [oracle.bias_force(unit, qd) - straight for unit in units]
    return np.array(columns).T[1:] / small


@pytest.mark.parametrize("elements", [1, 2, 5])
def test_matrices_equal_those_of_the_textbook(elements):
    length, rigidity, density = 1.4142, 105.0, 0.61732
    book = textbook_beam(length, rigidity, density, elements)
    link = Link(
        length=length, flexural_rigidity=rigidity, mass_per_length=density, elements=elements
    )
    oracle = LagrangianOracle(ArmSpec(links=[link]))
    mass = oracle.mass_matrix(np.zeros(oracle.dof))
    np.testing.assert_allclose(mass[0, 0], density * length**3 / 3, rtol=ROUNDING)
    np.testing.assert_allclose(mass[0, 1:], book.moment, rtol=ROUNDING)
    np.testing.assert_allclose(mass[1:, 1:], book.mass, rtol=ROUNDING, atol=1e-16)
    stiffness = bending_stiffness(oracle, 0.0)
    np.testing.assert_allclose(
        stiffness, book.stiffness, rtol=ROUNDING, atol=ROUNDING * abs(stiffness).max()
    )


@pytest.mark.parametrize(
    ("elements", "squares"),
    [
        (1, [3.5327315428, 34.8068931082]),
        (2, [3.5177150416, 22.2214744741, 75.1570830588, 218.1380245556]),
    ],
)
def test_frequencies_of_coarse_meshes(elements, squares):
    oracle = quick(ArmSpec(links=[cantilever(elements)]))
    # Published to ten decimals.
    np.testing.assert_allclose(clamped_frequencies(oracle), squares, rtol=0, atol=6e-11)


def test_rotary_inertia_lowers_frequencies_as_in_rayleighs_beam():
    # Slenderness L/r = 10; the exact Rayleigh beam has 3.4368076210, 19.136370248.
    link = cantilever(12, rotary_inertia_per_length=0.01)
    found = clamped_frequencies(quick(ArmSpec(links=[link])))[:2]
    # Twelve cubic elements: relative error (beta h)^4 / 1440 is 4e-7 and 2e-5.
    np.testing.assert_allclose(found, [3.4368076210, 19.136370248], rtol=2e-5)


def test_tapered_link_has_the_inertia_of_its_table():
    # Mass 4 - 2x per metre up to x = 0.7, then constant: integrals by hand.
    table = SectionTable(
        x=[0.0, 0.7, 1.0],
        flexural_rigidity=[5.0, 3.0, 3.0],
        mass_per_length=[4.0, 2.6, 2.6],
        rotary_inertia_per_length=[0.2, 0.1, 0.1],
    )
    spec = ArmSpec(links=[Link(length=1.0, table=table, elements=3)], gravity=(0.0, -10.0))
    oracle = quick(spec)
    rest = np.zeros(oracle.dof)
    about_root = 4 * 0.7**3 / 3 - 2 * 0.7**4 / 4 + 2.6 * (1 - 0.7**3) / 3 + 0.15 * 0.7 + 0.1 * 0.3
    moment = 4 * 0.7**2 / 2 - 2 * 0.7**3 / 3 + 2.6 * (1 - 0.7**2) / 2
    np.testing.assert_allclose(oracle.mass_matrix(rest)[0, 0], about_root, rtol=ROUNDING)
    np.testing.assert_allclose(oracle.bias_force(rest, rest)[0], 10 * moment, rtol=ROUNDING)


@pytest.mark.parametrize(
    ("damping", "expected"),
    [
        (ModalDamping(ratio=0.03), lambda w: 0.03 + 0 * w),
        (ModalDamping(ratio=[0.03, 0.01, 0.02]), lambda w: np.array([3, 1, 2, 2, 2, 2]) / 100),
        (
            RayleighDamping(mass_coefficient=0.2, stiffness_coefficient=1e-3),
            lambda w: 0.2 / (2 * w) + 1e-3 * w / 2,
        ),
    ],
)
def test_damping_ratio_of_every_clamped_mode(damping, expected):
    link = cantilever(3, damping=damping, rotary_inertia_per_length=0.001)
    oracle = quick(ArmSpec(links=[link]))
    mass = oracle.mass_matrix(np.zeros(oracle.dof))[1:, 1:]
    squares, modes = scipy.linalg.eigh(bending_stiffness(oracle, 0.0), mass)
    rest = np.zeros(oracle.dof)
    forces = np.array([oracle.bias_force(rest, unit) for unit in np.eye(oracle.dof)[1:]])[:, 1:]
    frequencies = np.sqrt(squares)
    wanted = np.diag(2 * expected(frequencies) * frequencies)
    found = modes.T @ forces.T @ modes
    np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9 * wanted.max())


@pytest.mark.parametrize(
    ("rate", "lag"), [(1.0, [3.54323626967, 22.158457881]), (2.0, [3.62179696412, 22.5263111738])]
)
def test_second_order_theory_stiffens_a_spinning_beam(rate, lag):
    """In-plane frequencies of a beam turning about its root, hub radius zero.

    Wright, Smith, Thresher and Wang, J. Appl. Mech. 49 (1982), flapping; lag^2 = flap^2 - rate^2.
    """
    oracle = quick(ArmSpec(links=[cantilever(8)], theory="second_order"))
    mass = oracle.mass_matrix(np.zeros(oracle.dof))[1:, 1:]
    squares = scipy.linalg.eigh(bending_stiffness(oracle, rate), mass, eigvals_only=True)
    # Eight cubic elements: relative error (beta h)^4 / 1440 is 2e-6 and 8e-5.
    np.testing.assert_allclose(np.sqrt(squares[:2]), lag, rtol=8e-5)


def test_linear_theory_softens_a_spinning_beam():
    oracle = quick(ArmSpec(links=[cantilever(2)]))
    mass = oracle.mass_matrix(np.zeros(oracle.dof))[1:, 1:]
    squares = scipy.linalg.eigh(bending_stiffness(oracle, 2.0), mass, eigvals_only=True)
    np.testing.assert_allclose(squares[0], 3.5177150416**2 - 2.0**2, rtol=1e-10)


@pytest.mark.parametrize(("gravity", "lowest"), [(1.0, 3.73262569953), (10.0, 5.29178335724)])
def test_weight_stiffens_a_hanging_beam(gravity, lowest):
    """First frequency of a clamped link hanging along x; the linear theory would keep 3.516."""
    spec = ArmSpec(links=[cantilever(8)], gravity=(gravity, 0.0), theory="second_order")
    # Eight cubic elements: relative error (beta h)^4 / 1440 is a few 1e-6.
    np.testing.assert_allclose(clamped_frequencies(quick(spec))[0], lowest, rtol=1e-5)


def test_payload_and_hub_on_a_rigid_link():
    """A rigid pendulum with its payload beside the tip, by the parallel axis theorem."""
    link = Link(length=0.8, mass_per_length=1.5, flexible=False)
    spec = ArmSpec(
        links=[link],
        joints=[Joint(hub_inertia=0.07, mass=3.0, housing_inertia=0.2, damping=0.6)],
        payload=Payload(mass=0.9, inertia=0.04, offset=(0.1, -0.25)),
        gravity=(2.0, -9.0),
    )
    oracle = quick(spec)
    angle, rate = 0.6, 1.7
    inertia = 1.5 * 0.8**3 / 3 + 0.07 + 0.04 + 0.9 * (0.9**2 + 0.25**2)
    assert oracle.dof == 1
    np.testing.assert_allclose(oracle.mass_matrix([angle]), [[inertia]], rtol=ROUNDING)
    first = np.array([1.2 * 0.4 + 0.9 * 0.9, 0.9 * -0.25])  # int (x, y) dm in body axes
    c, s = np.cos(angle), np.sin(angle)
    x, y = c * first[0] - s * first[1], s * first[0] + c * first[1]
    bias = oracle.bias_force([angle], [rate])
    np.testing.assert_allclose(bias, [-(x * -9.0 - y * 2.0) + 0.6 * rate], rtol=ROUNDING)
    kinetic, strain, potential = oracle.energy([angle], [rate])
    np.testing.assert_allclose(
        [kinetic, strain, potential], [inertia * rate**2 / 2, 0.0, 9 * y - 2 * x], rtol=ROUNDING
    )
    np.testing.assert_allclose(oracle.tip([angle]), [0.8 * c, 0.8 * s, angle], rtol=ROUNDING)
