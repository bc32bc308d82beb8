"""Scenarios: values that must match the arm, and settings that must match each other."""

import numpy as np

from flexarm.model import ArmSpec, Link, Scenario, TorqueDrive
from flexarm.model.drives import NoDrive
from flexarm.model.scenarios.scenario import InitialState, RunSpec

LINK = Link(length=1, flexural_rigidity=1, mass_per_length=1)
ARM = ArmSpec(links=[LINK, LINK])
RUN = {"duration": 2}
LINE = {"kind": "line", "start": [2, 0], "end": [1, 1], "duration": 1}


def test_defaults():
    scenario = Scenario(arm=ARM, run=RUN)
    assert scenario.drive == NoDrive()
    assert scenario.motion is None
    assert scenario.initial == InitialState(joint_angle=None, joint_rate=None)
    assert scenario.run == RunSpec(duration=2.0, rate=None, integrator="auto")
    motion = Scenario(arm=ARM, run=RUN, motion=LINE).motion
    assert (motion.profile, motion.elbow, motion.start_time) == ("quintic", "up", 0.0)


def test_torque_accepts_an_array():
    drive = TorqueDrive(rate=100, values=np.arange(6).reshape(3, 2))
    assert drive.values == ((0.0, 1.0), (2.0, 3.0), (4.0, 5.0))
    assert Scenario(arm=ARM, run=RUN, drive=drive).drive is drive
