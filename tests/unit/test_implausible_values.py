"""Numbers in wrong units are accepted with a warning."""

import contextlib
import re
import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.base.errors import InputError

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


def warned(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [str(w.message) for w in caught if w.category is fa.ImplausibleValueWarning]


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda arm: fa.simulate(arm, 0.1, initial=arm.rest([90.0])), r"initial contains 90 rad"),
        (
            lambda arm: fa.joint_motion(arm, [-45], [90], 1.0),
            r"start contains 45 rad.*end contains 90",
        ),
        (lambda arm: fa.simulate(arm, 0.1, rate=0.001), r"rate is 0.001 Hz.*mean 1000 Hz"),
        (
            lambda arm: fa.simulate(
                arm,
                0.05,
                controller=fa.JointPD(200.0, 20.0, sample_time=1.0),
                reference=fa.joint_motion(arm, [0], [0.1], 100.0),
            ),
            r"sample_time is 1 s.*0.001 s \(ms\).*reference.duration is 100 s.*0.1 s \(ms\)",
        ),
        (lambda arm: fa.Plant(arm, 0.01).reset(arm.rest([90.0])), r"initial contains 90 rad"),
        (
            lambda arm: fa.simulate_batch(arm, 0.1, initial=np.tile(arm.rest([45.0]), (3, 1))),
            r"initial contains 45 rad",
        ),
        (
            lambda arm: fa.circle_motion(arm, (0.2, 0.0), (0.25, 0.0), 360.0, 1.0),
            r"angle contains 360 rad",
        ),
    ],
)
def test_arguments_of_calls(call, text):
    arm = fa.Arm(links=[LINK], joints=[{"hub_inertia": 0.1}])
    if "circle" in text or ("angle" in text and "initial" not in text):
        arm = fa.Arm(links=[LINK.replace(length=0.2)] * 2)
    found = warned(lambda: _tried(call, arm))
    assert len(found) == 1, found
    assert re.search(text, found[0])


def _tried(call, arm):
    with contextlib.suppress(InputError):  # a circle of many turns leaves the reach
        call(arm)
