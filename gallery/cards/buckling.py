"""Buckling

A load beyond Euler's pushes a column out of its straight line.

[Find an equilibrium](../how-to/find-equilibrium.md)
"""

import numpy as np

import flexarm as fa

damped = fa.RayleighDamping(stiffness_coefficient=0.02)
column = {"length": 1.0, "flexural_rigidity": 1.0, "mass_per_length": 0.05, "damping": damped}
link = fa.Link(elements=8, segments=8, **column)
arm = fa.Arm(
    links=[link], joints=[fa.Joint(fixed=True, mounting_angle=np.pi / 2)], theory="second_order"
)
euler = np.pi**2 / 4  # N, of the clamped column
run = fa.simulate(arm, 6.0, tip_force=(0.02, -1.15 * euler), rate=100.0)
fa.animate(run, "buckling.html", channels="link_tip_deflection", torque=False)
