"""Joints that stick, stops and contacts in one run: steps end where any of them changes."""

import numpy as np
import pytest

import flexarm as fa

FLOOR = fa.Contact(fa.Wall((0.0, -0.9), (0.0, 1.0)), stiffness=1e4, damping=0.2)


def arm(seed, limits=None):
    rng = np.random.default_rng(seed)
    links = [
        fa.Link(length=1.0, mass_per_length=1.0, flexural_rigidity=400.0, modes=2) for _ in range(2)
    ]
    joints = [
        fa.Joint(friction=fa.Friction(coulomb=rng.uniform(0.5, 2.0)), limits=limits),
        fa.Joint(friction=fa.Friction(coulomb=rng.uniform(0.2, 2.0))),
    ]
    return fa.Arm(links=links, joints=joints, gravity=(0.0, -9.81), theory="second_order")


def pushed(duration, plant, **settings):
    return fa.simulate(
        plant,
        duration,
        initial=plant.rest([0.3, 0.4]),
        torque=lambda t: [7.5 * np.sin(9.0 * t), 4.0 * np.sin(17.0 * t)],
        contacts=[FLOOR],
        rate=100.0,
        **settings,
    )


@pytest.mark.sampled("kennedy_carpenter_5-0", "dormand_prince_8-0")
@pytest.mark.filterwarnings("ignore::flexarm.AccuracyWarning")  # of blows that amplify errors
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("integrator", ["dormand_prince_8", "kennedy_carpenter_5"])
def test_runs_end_and_agree(seed, integrator):
    """A step that is repeated for a joint that sticks once began with contacts at its old end."""
    limits = fa.JointLimits(lower=-1.5, upper=1.5, stiffness=500.0, damping=0.1)
    plant = arm(seed, limits if seed % 2 else None)
    exact = pushed(0.9, plant, integrator="dormand_prince_8", rtol=1e-11)
    result = pushed(0.9, plant, integrator=integrator)
    assert result.steps < 20_000
    # The first blows amplify the error of 1e-7 of the reach by at most a hundred.
    assert np.abs(result.tip - exact.tip).max() < 2e-5


def test_friction_that_holds_after_a_change_needs_a_method_that_locks_joints():
    plant = fa.Arm(
        links=[fa.Link(length=1.0, flexible=False, mass_per_length=0.8)],
        joints=[fa.Joint(friction=fa.Friction(coulomb=0.0))],
        gravity=(0.0, -9.81),
    )
    change = fa.Change("joints[0].friction.coulomb", at=0.2, to=40.0)
    settings = {"initial": plant.rest([0.0]), "changes": [change]}
    held = fa.simulate(plant, 1.0, **settings).joint_rate.values
    assert np.all(held[-100:] == 0.0)
    with pytest.raises(fa.SimulationError, match="generalized_alpha does not support"):
        fa.simulate(plant, 1.0, integrator="generalized_alpha", step=1e-3, **settings)
