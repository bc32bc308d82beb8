"""Slider-crank

A crank turns at constant speed; the inertia of the coupler bends it in every stroke.

[Build a mechanism](../how-to/build-a-mechanism.md)
"""

import numpy as np

import flexarm as fa

arm = fa.Arm(
    links=[
        fa.Link(length=0.15, mass_per_length=0.5, flexible=False),
        fa.Link(length=0.5, flexural_rigidity=12.0, mass_per_length=0.4, modes=3),
        fa.Link(length=0.05, mass_per_length=8.0, parent=0, flexible=False),
    ],
    joints=[fa.Joint(), fa.Joint(), fa.Joint(kind="prismatic")],
    closures=[fa.Closure(link=2, to_link=3, to_station=0.0)],
    theory="second_order",
)
speed = 25.0  # rad/s
start = fa.assembled(arm, arm.rest([0.0, 0.0, 0.65]), arm.rest([speed, 0.0, 0.0]), held=[1])
turn = fa.PrescribedAngle(lambda t: speed * t, lambda t: speed, lambda t: 0.0)
options = {"initial": start.q, "initial_rate": start.qd, "prescribed": {1: turn}}
run = fa.simulate(arm, 3 * 2 * np.pi / speed, rate=2000.0, **options)
fa.animate(run, "slider_crank.html", channels=[], torque=False, trace=False, speed=0.2)
