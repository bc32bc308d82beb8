"""Crane

A flexible boom luffs under a load that hangs on a rope.

[Validation: crane with a hanging load](../gallery/mechanisms.md)
"""

import numpy as np

import flexarm as fa

boom = fa.Link(length=6.0, flexural_rigidity=1.5e6, mass_per_length=30.0, elements=2)
rope = fa.Link(length=2.5, mass_per_length=0.5, flexible=False)
joints = [fa.Joint(hub_inertia=300.0), fa.Joint(damping=20.0)]
arm = fa.Arm(
    links=[boom, rope], joints=joints, payload=fa.Payload(mass=200.0), gravity=(0.0, -9.81)
)
low, high = [0.4, -np.pi / 2 - 0.4], [1.0, -np.pi / 2 - 1.0]  # the rope hangs
luff = fa.joint_motion(arm, low, high, 2.0, start_time=0.3)
drives = fa.JointPD([1e5, 0.0], [2e4, 0.0], feedforward=lambda t: [11e3 * np.cos(0.7), 0.0])
start = fa.equilibrium(arm, low).q
run = fa.simulate(arm, 6.0, controller=drives, reference=luff, initial=start, rate=100.0)
fa.animate(run, "crane.html", channels=[], torque=False, speed=1.5)
