"""Gantry

Two slides carry a hanging beam with a payload, which swings when they stop.

[Sliding joints](../how-to/build-a-mechanism.md#sliding-joints)
"""

import numpy as np

import flexarm as fa

block = {"length": 0.1, "flexible": False}
beam = {"flexural_rigidity": 15.0, "mass_per_length": 0.5, "elements": 2}
arm = fa.Arm(
    links=[
        fa.Link(mass_per_length=20.0, **block),
        fa.Link(mass_per_length=10.0, **block),
        fa.Link(length=0.8, **beam),
    ],
    joints=[
        fa.Joint(kind="prismatic"),
        fa.Joint(kind="prismatic", axis=(0.0, 1.0)),
        fa.Joint(fixed=True, mounting_angle=-np.pi / 2),
    ],
    payload=fa.Payload(mass=0.3),
)
motion = fa.joint_motion(arm, [0.0, 0.0], [1.5, 0.3], duration=1.0, start_time=0.2)
law = fa.JointPD(proportional=2000.0, derivative=300.0)
run = fa.simulate(arm, 3.5, controller=law, reference=motion)
fa.animate(run, "gantry.html", channels=[], torque=False)
