"""Numbers in wrong units are accepted with a warning."""

import warnings

import numpy as np
import pytest

import flexarm as fa

LINK = fa.Link(length=0.5, flexural_rigidity=30.0, mass_per_length=0.4, elements=1)


def arm_of(distance=0.002, backlash=0.0):
    link = LINK.replace(gauges=[fa.Gauge(station=0.1, distance=distance)])
    joint = fa.Joint(rotor_inertia=0.1, stiffness=50.0, backlash=backlash)
    return fa.Arm(links=[link], joints=[joint], gravity=(0.0, -9.81))


def test_distances_of_gauges_and_backlashes():
    with pytest.warns(fa.ImplausibleValueWarning, match=r"distance is 0.5 m, 1 of the length"):
        arm_of(distance=0.5)
    with pytest.warns(fa.ImplausibleValueWarning, match=r"backlash is 5 rad, 286.5 deg"):
        arm_of(backlash=5.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        arm_of(distance=-0.05, backlash=0.3)


@pytest.mark.parametrize(
    "call",
    [
        lambda arm, angle: fa.modes(arm, [angle]),
        lambda arm, angle: fa.equilibrium(arm, [angle]),
        lambda arm, angle: fa.MeasuredRecord(
            fa.simulate(arm, 0.01, rate=400.0), initial_angle=[angle], outputs=["joint_angle"]
        ),
    ],
)
def test_postures_in_degrees(call):
    arm = arm_of()
    with pytest.warns(fa.ImplausibleValueWarning, match=r"45 rad, more than two turns"):
        call(arm, 45.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        call(arm, np.radians(45.0))
        call(arm, 13.7)  # a joint that made more than two turns
