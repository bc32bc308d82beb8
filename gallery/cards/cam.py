"""Cam and follower

An eccentric disk lifts a flexible lever.

[Closures along curves](../how-to/build-a-mechanism.md)
"""

import numpy as np

import flexarm as fa

arm = fa.Arm(
    links=[
        fa.Link(length=0.1, mass_per_length=2.0, flexible=False),
        fa.Link(length=0.6, flexural_rigidity=12.0, mass_per_length=0.4, parent=0, modes=3),
    ],
    joints=[fa.Joint(), fa.Joint(offset=(-0.35, 0.1), stiffness=12.0, rest_angle=-0.4)],
    payload=fa.Payload(mass=0.1),
    theory="second_order",
    closures=[
        fa.Closure(
            kind="curve",
            link=2,
            station=0.35,
            to_link=1,
            to_station=0.0,
            shape=fa.RoundWall(center=(0.04, 0.0), radius=0.1),
        )
    ],
)
speed = 6.0  # rad/s
start = fa.assembled(arm, arm.rest([0.0, 0.0]), arm.rest([speed, 0.0]), held=[1])
turn = fa.PrescribedAngle(lambda t: speed * t, lambda t: speed, lambda t: 0.0)
options = {"initial": start.q, "initial_rate": start.qd, "prescribed": {1: turn}}
run = fa.simulate(arm, 2 * 2 * np.pi / speed, rate=1000.0, **options)
fa.animate(run, "cam.html", channels=[], torque=False, trace=False, speed=0.4, fps=20)
