"""Free flyer

Two arms on a floating body: when they move, the body turns the other way.

[A base that moves](../how-to/build-a-mechanism.md#a-base-that-moves)
"""

import numpy as np

import flexarm as fa

beam = {"length": 0.8, "flexural_rigidity": 15.0, "mass_per_length": 0.5, "elements": 2}
arm = fa.Arm(
    base=fa.Base(mass=4.0, inertia=0.5, free=("x", "y", "angle")),
    links=[fa.Link(**beam), fa.Link(parent=0, **beam)],
    joints=[
        fa.Joint(offset=(0.3, 0.0), hub_inertia=0.05),
        fa.Joint(offset=(-0.3, 0.0), hub_inertia=0.05, mounting_angle=np.pi),
    ],
    payload=fa.Payload(mass=0.2),
)
reach = fa.joint_motion(arm, [-0.7, -0.7], [1.2, 1.2], 1.5, start_time=0.2)
drives = fa.JointPD([20.0, 20.0], [2.0, 2.0])
run = fa.simulate(arm, 3.0, controller=drives, reference=reach, rate=300.0)
fa.animate(run, "free_flyer.html", channels=[], torque=False, speed=0.7)
