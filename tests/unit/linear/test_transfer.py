"""Frequency responses and zeros of linear models, against closed forms and python-control."""

import sys

import numpy as np
import pytest

import flexarm as fa
from flexarm.linear.models.state_space import slowest_first

LINK = fa.Link(
    length=0.5,
    flexural_rigidity=3.0,
    mass_per_length=0.4,
    elements=1,
    damping={"kind": "modal", "ratio": 0.02},
)
RIGID = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
FELT = fa.Sensor("acceleration", 2, 0.01, name="felt")
MODEL = fa.linearize(fa.Arm(links=[LINK, LINK]), outputs=["joint_angle", "joint_rate", "tip", FELT])


def test_responses_equal_those_of_python_control(monkeypatch):
    """By NumPy: slycot, which python-control prefers, has fewer correct digits."""
    monkeypatch.setitem(sys.modules, "slycot", None)
    omega = np.geomspace(0.1, 1e3, 7)
    expected = MODEL.to_control()(1j * omega).transpose(2, 0, 1)
    found = MODEL.frequency_response(omega)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize(
    ("output", "integrations"),
    [("joint_angle[1]", 2), ("joint_rate[2]", 1), ("tip[y]", 2), ("felt[y]", 0)],
)
def test_response_vanishes_at_every_zero(output, integrations):
    """For places, rates and accelerations."""
    zeros = MODEL.zeros("torque[1]", output)
    assert zeros.size == len(MODEL.A) - integrations

    def response(s):
        states = np.linalg.solve(s * np.eye(len(MODEL.A)) - MODEL.A, MODEL.B[:, 0])
        k = MODEL.outputs.index(output)
        return abs(MODEL.C[k] @ states + MODEL.D[k, 0])

    # Zeros at the origin, of rates and accelerations, cancel the poles of the free joints there.
    away = zeros[np.abs(zeros) > 1e-3]
    assert away.size >= 6
    for zero in away:
        assert response(zero) < 1e-6 * response(1.05 * zero)


def test_response_of_a_rigid_pendulum():
    """angle / torque = 1 / (J s^2 + m g c): no zeros, gain 1 / |m g c - J omega^2|."""
    arm = fa.Arm(links=[RIGID], gravity=(0.0, -9.81))
    rest = fa.equilibrium(arm, [-np.pi / 2])
    model = fa.linearize(arm, rest, outputs="joint_angle")
    assert model.zeros().size == 0
    gain = model.frequency_response([1.0, 4.0])[:, 0, 0]
    np.testing.assert_allclose(gain, 1.0 / (3.0 * 9.81 * 0.5 - np.array([1.0, 16.0])), rtol=1e-12)


@pytest.mark.parametrize("first", [0, 1])
def test_order_of_poles_does_not_depend_on_rounding(first):
    """Rounding may make either of a conjugate pair larger."""
    pair = np.array([-0.05 - 10.0j, -0.05 + 10.0j])
    pair[first] *= 1.0 + 4e-15
    still = np.array([1e-16 + 3.0j, -1e-15 - 3.0j])
    found = slowest_first(np.concatenate([pair[::-1], still, [5.0, 1.0, 0.0]]))
    assert found.real[:2].tolist() == [0.0, 1.0]
    np.testing.assert_array_equal(np.sign(found.imag), [0, 0, -1, 1, 0, -1, 1])
    assert sorted(np.abs(found)) == pytest.approx(np.abs(found), rel=1e-12)
