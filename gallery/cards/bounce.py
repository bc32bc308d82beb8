"""Impact

An arm falls on a wavy ground, bounces and comes to rest.

[Simulate contact](../how-to/touch-a-surface.md)
"""

import numpy as np

import flexarm as fa

rod = {"flexural_rigidity": 60.0, "mass_per_length": 0.6, "elements": 2, "modes": 2}
arm = fa.Arm(
    links=[fa.Link(length=0.8, **rod), fa.Link(length=0.7, **rod)],
    joints=[fa.Joint(damping=0.3, stiffness=40.0, rest_angle=1.0), fa.Joint(damping=0.05)],
    payload=fa.Payload(mass=0.3),
    gravity=(0.0, -9.81),
    theory="second_order",
)
x = np.linspace(-0.2, 1.7, 10)
ground = fa.SurfaceTable(x, 0.05 * np.sin(5.0 * x) - 0.1)
touch = fa.Contact(ground, stiffness=5e4, damping=0.3, friction=0.2)
run = fa.simulate(arm, 2.0, initial=arm.rest([0.8, -0.3]), contacts=[touch])
fa.animate(run, "bounce.html", contacts=[touch], channels=[], torque=False, speed=0.4)
