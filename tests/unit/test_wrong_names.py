"""Misspelt arguments and attributes: errors that suggest the right name."""

import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.5)
ARM = fa.Arm(links=[LINK], joints=[fa.Joint(hub_inertia=0.05)])


def test_initial_rates_of_joints_name_the_conversion():
    with pytest.raises(fa.InputError, match=r"initial_rate must have shape .*Arm\.rest\("):
        fa.simulate(ARM, 0.1, initial_rate=[3.0])
    result = fa.simulate(ARM, 0.01, initial_rate=ARM.rest([3.0]))
    assert result.joint_rate.values[0, 0] == 3.0
