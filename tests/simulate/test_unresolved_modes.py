"""``cowell_4`` with steps that do not resolve the fastest modes: accurate, or stopped with an
error."""

import numpy as np
import pytest

import flexarm as fa
from arms import chain

HIGHEST = 19806.0  # rad/s, of ``hubbed`` stretched out


def hubbed(damping=0.0):
    """Return two links of small elements with all modes, whose joints have little inertia."""
    rod = {"flexural_rigidity": 1000.0, "mass_per_length": 0.54, "elements": 2}
    rod["damping"] = fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=damping)
    return chain((0.7, 0.7), [0.1, 0.1], **rod)


def run(arm, duration, torque, **settings):
    settings.setdefault("rtol", 1e-9)
    settings.setdefault("atol", 1e-11)
    return fa.simulate(arm, duration, torque=torque, rate=200.0, progress=False, **settings)


def apart(a, b):
    """Return the largest distance of the tips (m)."""
    return float(np.linalg.norm((a.tip - b.tip).values, axis=1).max())


@pytest.mark.sampled("0.0-2.2", "0.0-20.0", "0.002-1.8")
@pytest.mark.parametrize("turn", [1.8, 2.2, 2.5, 4.0, 20.0])
@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_jump_of_the_torque_gives_the_right_momentum(turn, damping):
    """The torque starts suddenly; the tip moves by 2 cm, and its error was 1 to 2 cm.

    Some coordinates have a separate formula, with which the start of the two-step method could
    leave the joints with a momentum that no torque had caused. The tolerance is about ten times the
    measured error.
    """
    torque = lambda t: np.array([1.0, 0.5])  # noqa: E731
    arm = hubbed(damping)
    fixed = run(arm, 0.1, torque, integrator="cowell_4", step=turn / HIGHEST)
    tight = run(arm, 0.1, torque, integrator="dormand_prince_8")
    assert float(np.ptp(tight.tip.values, axis=0).max()) > 0.01
    assert apart(fixed, tight) < 1e-5


@pytest.mark.parametrize("turn", [1.6, 2.0, 3.0, 6.0])
def test_vibrations_do_not_grow_from_stop_to_stop(turn):
    """The torque is constant for 5 ms: sixty stops, each of which ends a span and starts another.

    The rate at the end of a span increases vibrations that turn by 2 in a step by a fifth: the
    error of the tip was 20 times its motion. The tolerance is a hundredth of that motion.
    """
    ticks = 0.01 * np.array([[np.sin(3.1 * k), np.cos(2.0 * k)] for k in range(61)])
    settings = {"torque_interpolation": "hold"}
    arm = hubbed()
    fixed = run(arm, 0.3, ticks, integrator="cowell_4", step=turn / HIGHEST, **settings)
    tight = run(arm, 0.3, ticks, integrator="dormand_prince_8", **settings)
    moved = float(np.ptp(tight.tip.values, axis=0).max())
    assert apart(fixed, tight) < 0.01 * moved


def test_step_too_long_for_the_damping_is_shortened():
    """The fastest mode turns by 1.9 in a step of 0.1 ms and is damped at 5700 1/s: too much."""
    damping = fa.ModalDamping(ratio=0.15)
    link = fa.Link(
        length=0.7, flexural_rigidity=1000.0, mass_per_length=0.54, elements=2, damping=damping
    )
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.1)])
    torque = lambda t: np.array([1.0])  # noqa: E731
    fixed = run(arm, 0.1, torque, integrator="cowell_4", step=2.0 / HIGHEST)
    tight = run(arm, 0.1, torque, integrator="dormand_prince_8")
    assert apart(fixed, tight) < 1e-6


def spun():
    """Two light links."""
    return chain((0.6, 0.6), flexural_rigidity=60.0, mass_per_length=0.5, elements=1)


def test_motion_too_fast_for_the_step_is_stopped():
    """Strong torques of alternating sign accelerate the arm."""
    arm = spun()
    torque = lambda t: 8.0 * np.cos(20.0 * t + np.arange(2))  # noqa: E731
    with pytest.raises(fa.SimulationError, match="too long for this motion") as stop:
        run(arm, 0.3, torque, integrator="cowell_4", step=2e-3)
    assert stop.value.result.sizes["time"] > 1  # the partial result is kept
    fine = run(arm, 0.3, torque, integrator="cowell_4", step=1e-4)
    assert apart(fine, run(arm, 0.3, torque, integrator="dormand_prince_8")) < 1e-4


@pytest.mark.parametrize("steps", [4, 5, 8, 16, 32])
def test_fast_motion_is_stopped_for_any_number_of_steps_between_stops(steps):
    """Changes of the torque end spans; without the check the error was 8 to 50 mm.

    With up to three steps the one-step method takes them all, which is as accurate as ``rk4`` and
    needs no error.
    """
    arm = spun()
    hold = 4.6e-4 * steps  # the highest frequency there requires 0.47 ms
    times = np.arange(0.0, 0.3 + hold, hold)
    torque = 16.0 * np.cos(20.0 * times[:, None] + np.arange(2))
    settings = {"rate": 1.0 / hold, "torque_interpolation": "hold", "progress": False}
    try:
        found = fa.simulate(arm, 0.29, torque=torque, integrator="cowell_4", step=1e-3, **settings)
    except fa.SimulationError as error:
        assert "too long for this motion" in str(error)  # noqa: PT017
        return
    tight = fa.simulate(
        arm, 0.29, torque=torque, integrator="dormand_prince_8", rtol=1e-9, atol=1e-11, **settings
    )
    assert apart(found, tight) < 5e-3


def test_arm_at_rest_is_not_stopped_because_of_rounding():
    arm = hubbed()
    still = run(
        arm, 1.0, lambda t: np.zeros(2), integrator="cowell_4", step=2.0 / HIGHEST,
        initial=arm.rest([0.3, -0.5]),
    )  # fmt: skip
    assert float(np.ptp(still.tip.values, axis=0).max()) < 1e-9
