"""Five-bar

Two motors move a payload along a line; their links share its weight and bend.

[A flexible five-bar](../tutorials/flexible-five-bar.md)
"""

import flexarm as fa

beam = {"flexural_rigidity": 8.0, "mass_per_length": 0.4, "modes": 3}
crank, rod = fa.Link(length=0.4, **beam), fa.Link(length=0.5, **beam)
arm = fa.Arm(
    links=[crank, rod, crank.replace(parent=0), rod],
    joints=[
        fa.Joint(offset=(-0.2, 0.0), hub_inertia=0.005),
        fa.Joint(),
        fa.Joint(offset=(0.2, 0.0), hub_inertia=0.005),
        fa.Joint(),
    ],
    payload=fa.Payload(mass=0.3),
    closures=[fa.Closure(link=2, to_link=4)],
)
guess = fa.assembled(arm, arm.rest([2.2, -1.2, 0.9, 1.2])).q[arm.joint_index]
line = fa.line_motion(arm, [-0.25, 0.5], [0.25, 0.7], 0.5, start_time=0.1, posture=guess)
drives = fa.JointPD(
    [20, 0, 20, 0], [1, 0, 1, 0], feedforward=fa.rigid_torque(arm, line, actuated=[1, 3])
)
run = fa.simulate(arm, 1.4, controller=drives, reference=line, rate=500.0)
fa.animate(run, "five_bar.html", reference=line, channels=[], torque=False, speed=0.4)
