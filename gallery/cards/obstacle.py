"""Around an obstacle

The motion with the least energy within limits of torque, strain and clearance.

[Plan an optimal motion](../how-to/plan-an-optimal-motion.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 150.0, "mass_per_length": 0.5, "modes": 1}
arm = fa.Arm(
    links=[fa.Link(length=1.0, **rod), fa.Link(length=0.8, **rod)],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.02, mass=0.3)],
    payload=fa.Payload(mass=0.2),
)
post = fa.RoundWall((1.55, 1.0), 0.25)
limits = fa.MotionLimits(torque=[6.0, 2.0], joint_rate=4.0, obstacles=[post], clearance=0.02)
start, end = [0.0, 0.3], [1.2, 0.6]
motion = fa.optimal_motion(arm, start, end, "energy", limits, duration=1.6, intervals=80)
look = {"contacts": [fa.Contact(post, 1e3)], "channels": "torque", "torque": False}
fa.animate(motion.run, "obstacle.html", speed=0.5, **look)
