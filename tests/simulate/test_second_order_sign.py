"""Where the second-order theory ends, a run stops and says which link bends too far."""

import numpy as np
import pytest

import flexarm as fa

# Links bend further here than their theory holds for, on purpose.
pytestmark = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
START = [np.pi / 4, -np.pi / 2]


def torque(t):
    """A torque from the first instant on: it excites higher modes than a smooth one does."""
    return [0.0, 3.0]


def table_one_arm(theory="second_order", **fields):
    links = [fa.Link(length=length, **{"elements": 8, **fields}, **ROD) for length in (1.4142, 1.0)]
    return fa.Arm(links=links, theory=theory)


def run(arm, duration=0.3):
    return fa.simulate(arm, duration, torque=torque, initial=arm.rest(START), rate=1000)


def test_a_full_mesh_of_eight_elements_stops():
    with pytest.raises(fa.SimulationError) as told:
        run(table_one_arm())
    error = told.value
    assert error.time == pytest.approx(0.031, abs=0.002)
    assert "mass matrix is about to lose its sign at link 1" in str(error)
    assert "segments" in error.hint
    assert "theory='linear'" in error.hint
    # What was computed until then is there, finite, and on the way of a run that goes on.
    q, qd = error.state
    assert np.all(np.isfinite(q))
    assert np.all(np.isfinite(qd))
    recorded = error.result
    assert recorded.time.values[-1] == pytest.approx(error.time, abs=1.5e-3)
    reduced = run(table_one_arm(modes=3))
    # As far as three modes follow a sudden torque.
    np.testing.assert_allclose(
        recorded.tip.values, reduced.tip.values[: len(recorded.time)], rtol=0, atol=5e-4
    )


@pytest.mark.parametrize("fields", [{"modes": 3}, {"segments": 4}, {"elements": 2}])
def test_what_the_hint_says_helps(fields):
    result = run(table_one_arm(**fields))
    assert result.time.values[-1] == pytest.approx(0.3)
    # All of them solve the same problem; a sudden torque shows what few modes leave out.
    np.testing.assert_allclose(result.tip.values[-1], [2.1293, 0.7962], rtol=0, atol=5e-4)


def test_the_linear_theory_goes_on():
    assert run(table_one_arm("linear")).failure == ""


def test_the_link_is_named_by_its_own_number():
    """A first link in segments: the second is body five, and still link 2."""
    stiff = fa.Link(length=1.0, elements=4, segments=4, flexural_rigidity=1e4, mass_per_length=60)
    soft = fa.Link(length=1.0, elements=8, flexural_rigidity=5.0, mass_per_length=0.6)
    heavy = [fa.Joint(hub_inertia=100.0), fa.Joint(mass=100.0, housing_inertia=10.0)]
    arm = fa.Arm(links=[stiff, soft], joints=heavy, theory="second_order")
    with pytest.raises(fa.SimulationError, match="lose its sign at link 2:"):
        fa.simulate(arm, 1.0, torque=lambda t: [0.0, 3.0 * np.sin(45.0 * t)])


def test_a_joint_whose_motion_is_given_needs_no_inertia():
    """Its torque is whatever it takes: the same link goes on where a free joint has to stop."""
    link = fa.Link(length=10.0, flexural_rigidity=1.4e4, mass_per_length=1.2, elements=8)
    arm = fa.Arm(links=[link], theory="second_order")
    given = fa.PrescribedAngle(
        lambda t: (1.0 - np.cos(20.0 * t)) / 200.0,
        lambda t: np.sin(20.0 * t) / 10.0,
        lambda t: 2.0 * np.cos(20.0 * t),
    )
    result = fa.simulate(arm, 1.0, prescribed={1: given}, rate=200)
    assert abs(result.link_tip_deflection.values).max() > 0.1
    with pytest.raises(fa.SimulationError, match="lose its sign at link 1:"):
        fa.simulate(arm, 1.0, torque=result.torque.values, rate=200)
