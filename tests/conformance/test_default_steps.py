"""Every fixed-step method of the registry finds its step, or fails if none is short enough."""

from functools import cache

import numpy as np
import pytest
from integrator_runs import double_pendulum

import flexarm as fa
from flexarm.integrate import INTEGRATORS

FIXED = [name for name, kind in INTEGRATORS.items() if not kind.adaptive]


def pendulum():
    """Return a rigid rod released from the horizontal; no vibration limits its step."""
    arm = fa.Arm(
        links=[fa.Link(length=1.0, flexible=False, mass_per_length=1.0)], gravity=(0.0, -9.81)
    )
    return arm, {}


def driven(joint, flexible, torque):
    """Return one rod on a joint, and a constant torque."""
    link = fa.Link(
        length=1.0,
        mass_per_length=0.05,
        flexible=flexible,
        flexural_rigidity=100.0 if flexible else None,
        elements=1,
        modes=1 if flexible else None,
    )
    return fa.Arm(links=[link], joints=[joint]), {"torque": lambda t: [torque]}


def rod_to_stop():
    """Return a rod with three impacts on two stops, each of 10 ms."""
    limits = fa.JointLimits(lower=-0.5, upper=0.5, stiffness=1e4, damping=0.1)
    return driven(fa.Joint(hub_inertia=0.1, limits=limits), False, 1.0)


def rod_that_sticks():
    """Return a rod that friction stops after 0.1 s; explicit steps of 2 ms would be unstable."""
    friction = fa.Friction(coulomb=1.0, smoothing_rate=0.01)
    return driven(fa.Joint(hub_inertia=0.01, friction=friction), True, 0.5)


def swinging_links():
    """Return two rigid links released from rest, whose motion amplifies small errors."""
    arm, state = double_pendulum()
    return arm, {"initial": state[0], "initial_rate": state[1]}


UNSTEPPED = {
    "pendulum": pendulum,
    "joint stops": rod_to_stop,
    "friction": rod_that_sticks,
    "double pendulum": swinging_links,
}


@cache
def unstepped(case):
    """Return arm, arguments, and the motion to 1e-12 by another method."""
    arm, settings = UNSTEPPED[case]()
    exact = fa.simulate(
        arm, 1.0, integrator="dormand_prince_8", rtol=1e-12, atol=1e-14, rate=100.0, **settings
    )
    return arm, settings, exact.tip


@pytest.mark.parametrize("case", UNSTEPPED)
@pytest.mark.parametrize("name", FIXED)
def test_without_a_step_the_tip_is_accurate_or_the_run_fails(name, case):
    """1e-3 of the reach is ten times the allowed difference of two trials."""
    arm, settings, exact = unstepped(case)
    result = fa.simulate(arm, 1.0, integrator=name, rate=100.0, **settings)
    apart = np.linalg.norm((result.tip - exact).values, axis=1)
    assert apart.max() < 1e-3 * arm.lengths.sum()
    assert "from that at twice the step" in result.integrator_reason


@pytest.mark.parametrize("name", FIXED)
def test_a_plant_without_a_step_compares_trials_at_each_sample_time(name):
    arm, _ = pendulum()
    plant = fa.Plant(arm, 0.05, integrator=name)
    for _ in range(20):
        plant.step([0.0])
    exact = fa.simulate(arm, 1.0, rtol=1e-12, atol=1e-14)
    assert np.linalg.norm(plant.tip[:2] - exact.tip.values[-1, :2]) < 1e-3


@pytest.mark.parametrize("step", [0.05, 0.25])
@pytest.mark.parametrize("name", FIXED)
def test_an_unstable_step_at_a_joint_stop_ends_the_run(name, step):
    """The joint in its stop has a period of 21 ms, so steps of 2 and 12 periods are unstable.

    The run must end before the joint rate, 3 rad/s in the exact motion, grows by orders of
    magnitude.
    """
    arm, settings = rod_to_stop()
    with pytest.raises(fa.SimulationError) as caught:
        fa.simulate(arm, 20.0, integrator=name, step=step, rate=100.0, **settings)
    assert abs(caught.value.result.joint_rate.values).max() < 100.0
