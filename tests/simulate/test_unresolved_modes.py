"""``cowell_4`` with steps that do not resolve the fastest modes: right, or stopped aloud."""

import numpy as np
import pytest

import flexarm as fa

HIGHEST = 19806.0  # rad/s, of ``hubbed`` stretched out


def hubbed(damping=0.0):
    """Two links of small elements with all their modes: joints feel next to no inertia."""
    links = [
        fa.Link(
            length=0.7,
            flexural_rigidity=1000.0,
            mass_per_length=0.54,
            elements=2,
            damping=fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=damping),
        )
        for _ in range(2)
    ]
    return fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.1)])


def run(arm, duration, torque, **settings):
    settings.setdefault("rtol", 1e-9)
    settings.setdefault("atol", 1e-11)
    return fa.simulate(arm, duration, torque=torque, rate=200.0, progress=False, **settings)


def apart(a, b):
    """Largest distance of the tips (m)."""
    return float(np.linalg.norm((a.tip - b.tip).values, axis=1).max())


@pytest.mark.parametrize("turn", [1.8, 2.2, 2.5, 4.0, 20.0])
@pytest.mark.parametrize("damping", [0.0, 2e-3])
def test_a_jump_of_the_torque_leaves_the_momentum_right(turn, damping):
    """The torque sets in at once; the tip moves by 2 cm, and was 1 to 2 cm off.

    Where some coordinates have a formula of their own, the start of the two-step method could leave
    the joints with momentum that no torque gave them. Allowed is about ten times what was measured.
    """
    torque = lambda t: np.array([1.0, 0.5])  # noqa: E731
    arm = hubbed(damping)
    fixed = run(arm, 0.1, torque, integrator="cowell_4", step=turn / HIGHEST)
    tight = run(arm, 0.1, torque, integrator="dormand_prince_8")
    assert float(np.ptp(tight.tip.values, axis=0).max()) > 0.01
    assert apart(fixed, tight) < 1e-5


@pytest.mark.parametrize("turn", [1.6, 2.0, 3.0, 6.0])
def test_vibrations_do_not_grow_from_stop_to_stop(turn):
    """A torque held for 5 ms: sixty stops, each the end of a span and the start of another.

    The rate at the end of a span makes vibrations that turn by 2 in a step larger by a fifth: the
    tip was off by 20 times what it moves. Allowed is a hundredth of that motion.
    """
    ticks = 0.01 * np.array([[np.sin(3.1 * k), np.cos(2.0 * k)] for k in range(61)])
    settings = {"torque_interpolation": "hold"}
    arm = hubbed()
    fixed = run(arm, 0.3, ticks, integrator="cowell_4", step=turn / HIGHEST, **settings)
    tight = run(arm, 0.3, ticks, integrator="dormand_prince_8", **settings)
    moved = float(np.ptp(tight.tip.values, axis=0).max())
    assert apart(fixed, tight) < 0.01 * moved


def test_a_step_too_long_for_the_damping_is_shortened():
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
    links = [
        fa.Link(length=0.6, flexural_rigidity=60.0, mass_per_length=0.5, elements=1)
        for _ in range(2)
    ]
    return fa.Arm(links=links)


def test_a_motion_too_fast_for_the_step_is_stopped():
    """Spun to and fro by strong torques."""
    arm = spun()
    torque = lambda t: 8.0 * np.cos(20.0 * t + np.arange(2))  # noqa: E731
    with pytest.raises(fa.SimulationError, match="too long for this motion") as stop:
        run(arm, 0.3, torque, integrator="cowell_4", step=2e-3)
    assert stop.value.result.sizes["time"] > 1  # what was computed is kept
    fine = run(arm, 0.3, torque, integrator="cowell_4", step=1e-4)
    assert apart(fine, run(arm, 0.3, torque, integrator="dormand_prince_8")) < 1e-4


@pytest.mark.parametrize("steps", [4, 5, 8, 16, 32])
def test_it_is_stopped_whatever_the_number_of_steps_between_two_stops(steps):
    """Held torques end a stretch each time; wrong by 8 to 50 mm where nobody looked.

    With up to three steps the one-step method makes them all: as good as ``rk4``, and as silent.
    """
    arm = spun()
    hold = 4.6e-4 * steps  # what the highest frequency asks for there is 0.47 ms
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


def test_an_arm_at_rest_is_not_stopped_for_its_rounding():
    arm = hubbed()
    still = run(
        arm, 1.0, lambda t: np.zeros(2), integrator="cowell_4", step=2.0 / HIGHEST,
        initial=arm.rest([0.3, -0.5]),
    )  # fmt: skip
    assert float(np.ptp(still.tip.values, axis=0).max()) < 1e-9
