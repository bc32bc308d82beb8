"""Strain feedback as boundary control: poles of the closed loop against the beam's equation.

Luo (1993) feeds back the curvature at the root of a beam, Luo and Guo (1997) the shear force
there, which two gauges measure. The oracle is the partial differential equation with a hub: its
solutions e^(s t) phi(x) have three constants, and the closed loop's poles are the zeros of their
determinant. No finite elements and no modes are involved.
"""

import numpy as np
import pytest
from scipy.optimize import root

import flexarm as fa

LENGTH, RIGIDITY, DENSITY, HUB, DISTANCE = 1.0, 10.0, 0.6, 0.05, 0.004
STATIONS = (0.02, 0.12)
P, D = 20.0, 3.0


def poles(strain, elements=12):
    """Return the five slowest poles (1/s) of the loop in continuous time."""
    gauges = [fa.Gauge(station=x, distance=DISTANCE) for x in STATIONS]
    beam = {"length": LENGTH, "flexural_rigidity": RIGIDITY, "mass_per_length": DENSITY}
    arm = fa.Arm(
        links=[fa.Link(**beam, elements=elements, gauges=gauges)],
        joints=[fa.Joint(hub_inertia=HUB)],
    )
    controller = fa.StrainFeedback(P, D, [strain])
    _, law = fa.loop_models(controller, arm, [0.0])
    model = fa.linearize(arm, arm.rest([0.0]), outputs=["joint_angle", "joint_rate", "strain"])
    found = np.linalg.eigvals(model.A + model.B @ law.D @ model.C)
    found = found[found.imag > 1e-6]
    return found[np.argsort(np.abs(found))][:5]


def exact(start, strain):
    """Return the pole of the partial differential equation next to a start, 1/s."""

    def shape(b, order, x):
        """Derivatives at x of sin, sinh and cos - cosh: phi(0) = 0."""
        s, c, sh, ch = np.sin(b * x), np.cos(b * x), np.sinh(b * x), np.cosh(b * x)
        rows = {1: [c, ch, -s - sh], 2: [-s, sh, -c - ch], 3: [-c, ch, s - sh]}
        return b**order * np.array(rows[order])

    def determinant(parts):
        pole = complex(*parts)
        b = (-DENSITY * pole**2 / RIGIDITY) ** 0.25
        felt = sum(
            gain * DISTANCE * shape(b, 2, x) for gain, x in zip(strain, STATIONS, strict=True)
        )
        # HUB theta'' = E I w''(0) - P theta - D theta' - gains times strains of -DISTANCE w''
        hub = (HUB * pole**2 + P + D * pole) * shape(b, 1, 0.0) - RIGIDITY * shape(b, 2, 0.0) - felt
        tip = [shape(b, order, LENGTH) / b**order / np.cosh(b * LENGTH) for order in (2, 3)]
        value = np.linalg.det([*tip, hub / b**3])
        return [value.real, value.imag]

    return complex(*root(determinant, [start.real, start.imag], tol=1e-13).x)


@pytest.mark.parametrize(
    "strain",
    [(0.0, 0.0), (300.0, 0.0), (3000.0, -3000.0)],
    ids=["joint PD", "curvature", "shear force"],
)
def test_poles_of_the_closed_loop_are_those_of_the_partial_differential_equation(strain):
    """Twelve cubic elements; strains converge with the square of their length."""
    for pole in poles(strain):
        assert pole == pytest.approx(exact(pole, strain), rel=1e-3)


def test_curvature_and_shear_force_damp_the_modes_of_the_link():
    """The two slowest poles are those of the joint, which yields and loses damping."""
    alone = poles((0.0, 0.0)).real[2:]
    for strain in ((300.0, 0.0), (3000.0, -3000.0)):
        assert np.all(poles(strain).real[2:] < 1.05 * alone)
    assert np.all(poles((3000.0, -3000.0)).real[2:] < 1.5 * alone)
    assert np.all(poles((3000.0, -3000.0)).real[:2] > poles((0.0, 0.0)).real[:2])
    # With the wrong sign, the shear force excites the fifth mode.
    assert poles((-3000.0, 3000.0)).real.max() > 0.0
