"""Moments from balance and moments from curvature converge with the mesh."""

import numpy as np
import pytest

import flexarm as fa

LENGTH, EI, MU = 1.2, 60.0, 0.7
STATIONS = 17


def swung(elements, element="euler_bernoulli", damping=None):
    """Return a link on a hub and its state at 0.2 s, under a torque that rises until 0.3 s."""
    fields = {"rotary_inertia_per_length": 0.002}
    if element == "timoshenko":
        fields |= {"element": element, "shear_rigidity": 2000.0}
    link = fa.Link(
        length=LENGTH,
        flexural_rigidity=EI,
        mass_per_length=MU,
        elements=elements,
        damping=damping,
        **fields,
    )
    payload = fa.Payload(mass=0.2, inertia=0.003)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.2)], payload=payload)
    result = fa.simulate(
        arm,
        0.2,
        torque=lambda t: [5.0 * np.sin(np.pi * t / 0.6) ** 4],
        rate=10.0,
        rtol=1e-11,
        atol=1e-13,
        stations=STATIONS,
    )
    return arm, result.isel(time=-1)


@pytest.mark.thorough_cases("euler_bernoulli")
@pytest.mark.parametrize("element", ["euler_bernoulli", "timoshenko"])
def test_curvature_times_rigidity_converges_to_the_moment(element):
    """The error is proportional to the square of the element length, because curvature is linear in
    elements."""
    errors, moments = [], []
    x = np.linspace(0.0, LENGTH, STATIONS)
    for elements in (4, 8, 16):
        arm, now = swung(elements, element)
        (piece,) = arm.assembly.pieces
        curvature = piece.shapes.curvature(x) @ now.q.values[piece.modal]
        moment = now.bending_moment.values[0]
        errors.append(abs(EI * curvature - moment).max() / abs(moment).max())
        moments.append(moment)
    assert errors[-1] < 1e-3
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all(abs(orders - 2.0) < 0.3)
    # The balance is as accurate as the motion, and a coarse mesh gives it nearly right.
    coarse = abs(moments[0] - moments[-1]).max() / abs(moments[-1]).max()
    assert coarse < errors[0] / 100


def test_moment_includes_kelvin_voigt_damping():
    """M = EI (v'' + beta v''')."""
    beta = 1e-2
    damping = fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=beta)
    arm, now = swung(16, damping=damping)
    (piece,) = arm.assembly.pieces
    shapes = piece.shapes.curvature(np.linspace(0.0, LENGTH, STATIONS))
    elastic = EI * shapes @ now.q.values[piece.modal]
    viscous = beta * EI * shapes @ now.qd.values[piece.modal]
    moment = now.bending_moment.values[0]
    size = abs(moment).max()
    assert abs(viscous).max() > 1e-2 * size
    np.testing.assert_allclose(elastic + viscous, moment, rtol=0, atol=1e-3 * size)
