"""Scenarios: values that must match the arm, and settings that must match each other."""

import numpy as np
import pytest

from flexarm.base.errors import ModelError
from flexarm.model import (
    ArmSpec,
    InitialState,
    Link,
    NoDrive,
    RunSpec,
    Scenario,
    TorqueDrive,
)
from flexarm.model.drives import CONTROLLED

LINK = Link(length=1, flexural_rigidity=1, mass_per_length=1)
ARM = ArmSpec(links=[LINK, LINK])
RUN = {"duration": 2}
LINE = {"kind": "line", "start": [2, 0], "end": [1, 1], "duration": 1}
JOINT = {"kind": "joint", "start": [0, 0], "end": [1, 1], "duration": 1}


def test_defaults():
    scenario = Scenario(arm=ARM, run=RUN)
    assert scenario.drive == NoDrive()
    assert scenario.motion is None
    assert scenario.initial == InitialState(joint_angle=None, joint_rate=None)
    assert scenario.run == RunSpec(duration=2.0, rate=1000.0, integrator="auto")
    motion = Scenario(arm=ARM, run=RUN, motion=LINE).motion
    assert (motion.profile, motion.elbow, motion.start_time) == ("quintic", "up", 0.0)


def test_torque_accepts_an_array():
    drive = TorqueDrive(rate=100, values=np.arange(6).reshape(3, 2))
    assert drive.values == ((0.0, 1.0), (2.0, 3.0), (4.0, 5.0))
    assert Scenario(arm=ARM, run=RUN, drive=drive).drive is drive


@pytest.mark.parametrize(
    ("values", "problems"),
    [
        (
            {"run": None},
            [
                (
                    "run must be a mapping of keys to values, got nothing. "
                    "It says how long to simulate, for example `run: {duration: 2}`."
                )
            ],
        ),
        (
            {"drive": {"kind": "rigid_inverse_dynamics"}},
            ["motion is required for drive rigid_inverse_dynamics."],
        ),
        (
            {"drive": {"kind": "joint_pd", "proportional": 1, "derivative": [1, 2, 3]}},
            [
                "motion is required for drive joint_pd.",
                "drive.derivative must have length 2, one value for each joint, got 3.",
            ],
        ),
        (
            {
                "drive": {"kind": "joint_pd", "proportional": [1, -2], "derivative": True},
                "motion": LINE,
            },
            [
                "drive.proportional[1] must be at least 0, got -2.",
                "drive.derivative must be a number, got True.",
            ],
        ),
        (  # rows of the same wrong length are reported once
            {"drive": {"kind": "torque", "rate": 1, "values": [[1, 2], [1], [1], [1, 2, 3]]}},
            [
                "drive.values[1] must have length 2, one value for each joint, got 1.",
                "drive.values[3] must have length 2, one value for each joint, got 3.",
            ],
        ),
        (
            {"drive": {"kind": "torque", "rate": 1, "values": [[1, 2]], "interpolation": "linear"}},
            [("drive.values must have at least two samples for linear interpolation, got 1.")],
        ),
        (
            {"drive": {"kind": "torque", "rate": 1, "values": []}},
            [
                "drive.values is empty.",
            ],
        ),
        (
            {"drive": {"kind": "joint_pdd"}},
            [
                (
                    "drive.kind must be one of 'rigid_inverse_dynamics', 'quasi_static', "
                    "'integral_manifold', 'flexible_torque', 'tip_inversion', 'torque', 'none', "
                    + "".join(f"{kind!r}, " for kind in CONTROLLED).removesuffix(", ")
                    + ", got 'joint_pdd'. Did you mean 'joint_pd'?"
                )
            ],
        ),
        (  # lengths are compared although other values of the same parts are wrong
            {
                "motion": {**JOINT, "start": [0], "end": ["a", 1, 2], "duration": 0},
                "initial": {"joint_angle": [0, 0, np.nan], "joint_rate": []},
            },
            [
                "motion.duration must be greater than 0, got 0.",
                "motion.end[0] must be a number, got 'a'. Write the bare number, in SI units.",
                "initial.joint_angle[2] must be a finite number, got nan.",
                "motion.start must have length 2, one value for each joint, got 1.",
                "motion.end must have length 2, one value for each joint, got 3.",
                "initial.joint_angle must have length 2, one value for each joint, got 3.",
                "initial.joint_rate must have length 2, one value for each joint, got 0.",
            ],
        ),
        (
            {"motion": {**LINE, "elbow": "left", "profile": "quintc", "start": [1, 2, 3]}},
            [
                (
                    "motion.profile must be one of 'quintic', 'trapezoidal', got 'quintc'. "
                    "Did you mean 'quintic'?"
                ),
                "motion.elbow must be one of 'up', 'down', got 'left'.",
                "motion.start must be a list of two numbers, got [1, 2, 3].",
            ],
        ),
        (
            {"run": {"duration": 10, "rate": 1e9, "step": 20, "rtol": 1, "integrator": 3}},
            [
                "run.integrator must be a word, got 3.",
                "run.rtol must be less than 1, got 1.",
                (
                    "run.rate must be at most 1e+06 for a duration of 10, got 1000000000. A "
                    "result has at most 1e+07 samples."
                ),
                "run.step must be at most 10 (the duration of the run), got 20.",
            ],
        ),
        (
            {"run": {"duration": 10, "stations": 1}},
            ["run.stations must be 0, or at least 2 (root and tip), got 1."],
        ),
        (
            {"run": {"duration": 10, "stations": 1001}},
            ["run.stations must be at most 1000, got 1001."],
        ),
        (
            {"run": {"duration": 10, "stations": 2.5}},
            ["run.stations must be a whole number, got 2.5."],
        ),
        (
            {"arm": "arm.yaml"},
            [
                (
                    "arm must be a mapping of keys to values, got 'arm.yaml'. "
                    "In Python, load_arm_spec reads a file."
                )
            ],
        ),
    ],
)
def test_wrong_scenarios_are_rejected_with_every_reason(values, problems):
    with pytest.raises(ModelError) as caught:
        Scenario(**{"arm": ARM, "run": RUN, **values})
    assert str(caught.value).splitlines() == [f"Scenario: {text}" for text in problems]


def test_joints_are_counted_in_an_arm_with_other_problems():
    arm = {"links": [{"length": 0, "flexural_rigidity": 1, "mass_per_length": 1}]}
    with pytest.raises(ModelError) as caught:
        Scenario(arm=arm, run=RUN, initial={"joint_angle": [0, 0]})
    assert str(caught.value).splitlines() == [
        "Scenario: arm.links[0].length must be greater than 0, got 0.",
        ("Scenario: initial.joint_angle must have length 1, one value for each joint, got 2."),
    ]


def test_a_key_that_looks_like_the_tag_of_a_union_is_unknown():
    with pytest.raises(ModelError, match=r"is not a known key\. Known: duration, rate"):
        RunSpec(**{"duration": 1, "<list>": 2})
