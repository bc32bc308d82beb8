"""Derivatives of runs through contacts and joint stops, against differences of accurate runs."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate import INTEGRATORS
from random_arms import random_spec

pytestmark = pytest.mark.compiled
#: Tolerances of the runs whose differences are compared.
TIGHT = {"rtol": 1e-12, "atol": 1e-14}
WALL = fa.Wall((0.0, -0.05), (0.0, 1.0))
X = np.linspace(-0.5, 2.5, 13)
CASES = {
    "bare": {"contacts": [fa.Contact(WALL, stiffness=2e4)]},
    "damped": {"contacts": [fa.Contact(WALL, stiffness=2e4, damping=0.3)]},
    "rubbing": {"contacts": [fa.Contact(WALL, stiffness=2e4, damping=0.3, friction=0.3)]},
    "repeated": {"contacts": [fa.Contact(WALL, stiffness=2e4, damping=0.5)], "duration": 0.9},
    "post": {"contacts": [fa.Contact(fa.RoundWall((1.75, -0.3), 0.15), stiffness=2e4)]},
    "ground": {
        "contacts": [fa.Contact(fa.SurfaceTable(X, 0.02 * np.sin(3.0 * X) - 0.05), stiffness=2e4)]
    },
    "stop": {"damping": 0.0},
    "damped stop": {"damping": 0.2},
}


def an_arm(payload=0.3, damping=None):
    rods = [
        {"length": 1.1, "flexural_rigidity": 130.0, "mass_per_length": 0.5, "modes": 2},
        {"length": 0.7, "flexural_rigidity": 60.0, "mass_per_length": 0.4, "modes": 1},
    ]
    limits = None
    if damping is not None:
        limits = fa.JointLimits(lower=-0.3, upper=0.5, stiffness=400.0, damping=damping)
    return fa.Arm(
        links=[fa.Link(damping=fa.ModalDamping(ratio=0.01), **rod) for rod in rods],
        joints=[
            fa.Joint(hub_inertia=0.1, damping=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02, damping=0.05, limits=limits),
        ],
        payload=fa.Payload(mass=payload),
        gravity=(0.0, -9.81),
        theory="second_order",
    )


def five_points(function, value, step):
    """Return the derivative of a function by the difference of order 4."""
    near = function(value + step) - function(value - step)
    far = function(value + 2.0 * step) - function(value - 2.0 * step)
    return (8.0 * near - far) / (12.0 * step)


def largest_error(found, wanted):
    return np.abs(found - wanted).max() / np.abs(wanted).max()


@pytest.mark.sampled("rubbing", "stop", "repeated")
@pytest.mark.parametrize("name", CASES)
def test_payload_mass(name):
    """The required accuracy is 1e-6; it was 3e-3 with stages on both sides of a contact."""
    case = {"duration": 0.5, "rate": 200.0, **CASES[name]}
    damping, duration = case.pop("damping", None), case.pop("duration")
    arm = an_arm(damping=damping)
    case["initial"] = arm.rest([0.2, 0.3])

    def angles(mass):
        moved = an_arm(mass, damping)
        return fa.simulate(moved, duration, **case, **TIGHT)["joint_angle"].values

    wanted = five_points(angles, 0.3, 3e-6)
    found = fa.sensitivities(arm, duration, ["payload.mass"], channels=["joint_angle"], **case)
    error = largest_error(found["joint_angle"].values[0], wanted)
    estimate = float(found["relative_error"][0])
    assert error < 1e-6
    assert error < 2.0 * estimate + 3e-8  # of the difference itself, by its rounding
    assert estimate < 1e-4
    # At loose tolerances the derivative is as accurate as the motion, without a second run.
    loose = {"rtol": 1e-5, "atol": 1e-7, "error_estimate": False, "channels": ["joint_angle"]}
    found = fa.sensitivities(arm, duration, ["payload.mass"], **loose, **case)
    assert "relative_error" not in found.coords
    assert largest_error(found["joint_angle"].values[0], wanted) < 2e-4


@pytest.mark.sampled("1", "3")
@pytest.mark.parametrize("seed", range(6))
def test_random_arms(seed):
    """A wall or a post is put in the way of the tip, soft or hard, bare or damped, rough or not."""
    rng = np.random.default_rng(seed)
    spec = random_spec(
        rng, links=int(rng.integers(1, 3)), elements=1, rigid=False, gravity=False, damping=True
    )
    arm = fa.Arm(spec)
    rate = np.zeros(arm.dof)
    rate[arm.joint_index] = rng.uniform(0.5, 2.0, arm.n_joints) * rng.choice([-1.0, 1.0])
    case = {"initial": arm.rest(rng.uniform(-1.0, 1.0, arm.n_joints)), "rate": 200.0}
    free = fa.simulate(arm, 0.1, initial_rate=rate, **case)
    tip, velocity = free["tip"].values[-1], free["tip_velocity"].values[-1]
    speed = np.linalg.norm(velocity)
    normal = -velocity / speed
    surface = fa.Wall(tuple(tip), tuple(normal))
    if seed % 2:
        surface = fa.RoundWall(tuple(tip - 0.2 * normal), 0.2)
    case["contacts"] = [
        fa.Contact(
            surface,
            stiffness=float(10.0 ** rng.uniform(4.0, 5.5)),
            damping=float(rng.choice([0.0, 0.3, 3.0]) / speed),
            friction=float(rng.choice([0.0, 0.2])),
        )
    ]

    def angles(value):
        moved = rate.copy()
        moved[0] = value
        return fa.simulate(arm, 0.2, initial_rate=moved, **case, **TIGHT)["joint_angle"].values

    wanted = five_points(angles, rate[0], 1e-5)
    found = fa.sensitivities(
        arm, 0.2, ["initial_rate[0]"], initial_rate=rate, channels=["joint_angle"], **case
    )
    error = largest_error(found["joint_angle"].values[0], wanted)
    assert error < 1e-6, (error, float(found["relative_error"][0]))


def test_runs_without_contact_have_no_second_run():
    arm = an_arm(damping=0.2)
    far = [fa.Contact(fa.Wall((0.0, -9.0), (0.0, 1.0)), stiffness=2e4)]
    given = {"initial": arm.rest([0.2, 0.3]), "contacts": far, "rate": 200.0}
    found = fa.sensitivities(arm, 0.1, ["payload.mass"], **given)
    assert "relative_error" not in found.coords
    assert found.attrs["steps"] == fa.simulate(arm, 0.1, **given).attrs["steps"]


@pytest.mark.parametrize("rtol", [1e-8, 1e-13])
def test_second_run_has_another_tolerance_than_a_tightened_run(rtol):
    """Both runs through a stop were once tightened to 1e-13, so that their difference was zero."""
    arm = an_arm(damping=0.2)
    given = {"initial": arm.rest([0.2, 0.3]), "rate": 200.0, "rtol": rtol, "atol": rtol / 100}
    found = fa.sensitivities(arm, 0.5, ["payload.mass"], channels=["joint_angle"], **given)
    assert 1e-12 < float(found["relative_error"][0]) < 1e-6


def test_an_inaccurate_derivative_warns():
    """With fixed steps no step ends at the contact; half the step gives the estimate."""
    arm = an_arm()
    given = {"initial": arm.rest([0.2, 0.3]), "rate": 200.0, **CASES["damped"], "step": 5e-4}
    with pytest.warns(fa.AccuracyWarning, match="estimated relative error"):
        found = fa.sensitivities(arm, 0.5, ["payload.mass"], channels=["joint_angle"], **given)
    assert float(found["relative_error"][0]) > 1e-3


@pytest.mark.parametrize("name", ["rubbing", "damped stop"])
def test_gradient_of_a_goal(name):
    case = {"rate": 100.0, "torque_interpolation": "linear", **CASES[name]}
    arm = an_arm(damping=case.pop("damping", None))
    torque = np.zeros((41, 2))
    case["initial"] = arm.rest([0.2, 0.3])
    found = fa.goal_gradient(arm, 0.4, {"tip": np.ones((41, 2))}, torque=torque, **case)
    assert found.attrs["relative_error"] < 1e-4

    def goal(value):
        moved = torque.copy()
        moved[7, 1] = value
        return fa.simulate(arm, 0.4, torque=moved, **case, **TIGHT)["tip"].values.sum()

    wanted = five_points(goal, 0.0, 1e-3)
    assert float(found["torque"][7, 1]) == pytest.approx(wanted, rel=1e-6)


def test_identification_through_blows():
    """The floor makes the angle of a joint depend on the payload for ever after."""
    arm = an_arm()
    given = {"contacts": CASES["rubbing"]["contacts"]}
    record = fa.simulate(
        arm, 0.5, initial=arm.rest([0.2, 0.3]), rate=200.0, torque=lambda t: [0.0, 0.0], **given
    )
    start = an_arm(0.33)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.IdentifiabilityWarning)
        found = fa.identify(start, record, ["payload.mass"], **given)
    assert found["payload.mass"] == pytest.approx(0.3, rel=1e-5)
    with pytest.raises(fa.InputError, match="method is not supported with contacts"):
        fa.identify(start, record, ["payload.mass"], method="prediction_error", **given)


@pytest.mark.parametrize("integrator", ["dormand_prince_8", "kennedy_carpenter_5"])
@pytest.mark.parametrize("name", ["rubbing", "damped stop"])
def test_runs_that_pause_continue_bit_for_bit(name, integrator, monkeypatch):
    case = {"rate": 100.0, "rtol": 1e-6, "atol": 1e-8, "integrator": integrator, **CASES[name]}
    arm = an_arm(damping=case.pop("damping", None))
    case["initial"] = arm.rest([0.2, 0.3])
    kind = INTEGRATORS[integrator]
    whole = fa.simulate(arm, 0.4, **case)
    advance = kind.advance

    def one_step(self, *given):
        return advance(self, *given[:-1], 1)

    monkeypatch.setattr(kind, "advance", one_step)
    parts = fa.simulate(arm, 0.4, **case)
    np.testing.assert_array_equal(parts["q"], whole["q"])
    assert parts.attrs["evaluations"] == whole.attrs["evaluations"]


def test_few_steps_are_rejected_at_contacts():
    """Every second step of this run was repeated when steps did not end at contacts."""
    arm = an_arm()
    run = fa.simulate(
        arm, 0.9, initial=arm.rest([0.2, 0.3]), contacts=CASES["repeated"]["contacts"]
    )
    assert run.attrs["rejected_steps"] < 0.25 * run.attrs["steps"]


@pytest.mark.thorough
def test_derivatives_through_stick_and_slip():
    """Each start and end of sticking adds the derivative of its time."""
    rod = {"length": 1.0, "flexural_rigidity": 60.0, "mass_per_length": 0.5, "elements": 2}
    rubs = [fa.Friction(coulomb=0.5, static=0.6), fa.Friction(coulomb=0.3)]
    arm = fa.Arm(
        links=[fa.Link(damping=fa.ModalDamping(ratio=0.02), **rod)] * 2,
        joints=[fa.Joint(hub_inertia=0.05, friction=friction) for friction in rubs],
    )

    def torque(t):
        return np.array([1.5 * np.sin(6.0 * t), 0.8 * np.sin(9.0 * t)])

    paths = ["joints[0].friction.coulomb", "links[0].flexural_rigidity"]
    given = {"torque": torque, "rate": 40.0, "channels": ["tip"], "error_estimate": True}
    found = fa.sensitivities(arm, 1.5, paths, **given)
    exact = fa.sensitivities(arm, 1.5, paths, rtol=1e-9, **given)
    assert largest_error(found.tip.values, exact.tip.values) < 1e-6
    assert found.relative_error.max() > 1e-6  # of the looser run
