"""Runs whose default samples alias the vibration of a fast arm give a warning."""

import warnings

import pytest

import flexarm as fa


def pushed(length, duration=0.2, **options):
    """Return an aluminium arm whose links scale with its length, and its run under a step."""
    width = length / 50.0
    mass = 2700.0 * width**2
    rod = {"flexural_rigidity": 70e9 * width**4 / 12.0, "mass_per_length": mass, "elements": 1}
    joint = fa.Joint(hub_inertia=0.3 * mass * length**3)
    arm = fa.Arm(links=[fa.Link(length=length, **rod)], joints=[joint])
    torque = 0.1 * mass * length**2
    return arm, fa.simulate(arm, duration, torque=lambda t: [torque], progress=False, **options)


def test_default_samples_of_a_fast_arm_give_a_warning_with_its_frequency():
    with pytest.warns(fa.AccuracyWarning, match="Use rate= of") as caught:
        arm, result = pushed(7e-4, integrator="dormand_prince_8")
    frequency = fa.modes(arm, joints="free").frequency_hz[1]
    assert frequency > 30e3
    text = str(caught[0].message)
    shown = float(text.partition("about ")[2].partition(" Hz")[0])
    assert shown == pytest.approx(frequency, rel=0.05)
    assert text in result.attrs["warning"]


@pytest.mark.parametrize("length", [0.05, 0.5, 5.0])
def test_ordinary_arms_and_a_given_rate_give_no_warning(length):
    """The frequency at the first length is 470 Hz, at the last one 4.7 Hz."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", fa.AccuracyWarning)
        pushed(length)
        pushed(7e-4, 0.02, integrator="dormand_prince_8", rate=1000.0)
