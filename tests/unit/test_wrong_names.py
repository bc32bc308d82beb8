"""Misspelt arguments and attributes: errors that suggest the right name."""

import subprocess
import sys

import pytest

import flexarm as fa

LINK = fa.Link(length=1.0, flexural_rigidity=100.0, mass_per_length=0.5)
ARM = fa.Arm(links=[LINK], joints=[fa.Joint(hub_inertia=0.05)])


def test_initial_rates_of_joints_name_the_conversion():
    with pytest.raises(fa.InputError, match=r"initial_rate must have shape .*Arm\.rest\("):
        fa.simulate(ARM, 0.1, initial_rate=[3.0])
    result = fa.simulate(ARM, 0.01, initial_rate=ARM.rest([3.0]))
    assert result.joint_rate.values[0, 0] == 3.0


@pytest.mark.parametrize(
    ("item", "wrong", "right"), [("arm", "tipp", "tip"), ("link", "lenght", "length")]
)
def test_python_suggests_attributes_of_our_objects(item, wrong, right):
    """The interpreter has the hint if the error names the object, and `dir` the attribute."""
    program = (
        "import flexarm as fa; link = fa.Link(length=1.0, mass_per_length=1.0, flexible=False); "
        f"arm = fa.Arm(links=[link]); {item}.{wrong}"
    )
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert f"Did you mean: '{right}'?" in ended.stderr


def test_long_lists_of_names_follow_the_suggestion():
    text = r"outputs must be a Sensor or one of 17 names, got 'tpi'\. Did you mean 'tip'\? They are"
    with pytest.raises(fa.InputError, match=text):
        fa.linearize(ARM, outputs=["tpi"])
    with pytest.raises(fa.InputError, match=r"one of 'locked', 'free' or gains .*got 'fre'"):
        fa.modes(ARM, joints="fre")  # short lists stay in the rule
    text = r"signal must be one of 20 names, got 3\. For the position.* Sensor\. They are"
    with pytest.raises(fa.ModelError, match=text):
        fa.Instrument(signal=3)
