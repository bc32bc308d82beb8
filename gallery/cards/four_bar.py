"""Four-bar

A rigid crank drives a flexible coupler and rocker, closed by a pin.

[Build a mechanism](../how-to/build-a-mechanism.md)
"""

import numpy as np

import flexarm as fa

bar = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "modes": 3}
arm = fa.Arm(
    links=[
        fa.Link(length=0.3, mass_per_length=0.5, flexible=False),
        fa.Link(length=0.9, **bar),
        fa.Link(length=0.7, parent=0, **bar),
    ],
    joints=[fa.Joint(), fa.Joint(), fa.Joint(offset=(1.0, 0.0))],
    closures=[fa.Closure(link=2, to_link=3)],
)
speed = 12.0  # rad/s
guess = arm.rest([1.0, -0.5, 1.6])
start = fa.assembled(arm, guess, arm.rest([speed, 0.0, 0.0]), held=[1])
turn = fa.PrescribedAngle(lambda t: 1.0 + speed * t, lambda t: speed, lambda t: 0.0)
options = {"initial": start.q, "initial_rate": start.qd, "prescribed": {1: turn}}
run = fa.simulate(arm, 3 * 2 * np.pi / speed, rate=1000.0, **options)
fa.animate(run, "four_bar.html", channels=[], torque=False, trace=False, speed=0.4)
