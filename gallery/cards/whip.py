"""Whip

A handle turns and stops; the strip behind it bends far beyond the reach of linear theories.

[Links that bend far](../how-to/large-deflection.md)
"""

import flexarm as fa

strip = fa.Link(
    length=1.0,
    flexural_rigidity=0.4,
    mass_per_length=0.1,
    elements=12,
    segments=12,
    damping=fa.RayleighDamping(stiffness_coefficient=0.01),
)
arm = fa.Arm(links=[strip], theory="second_order")
swing = fa.PrescribedAngle.table([0.1, 0.7, 1.2, 2.4], [0.3, 2.4, 0.9, 0.9])
run = fa.simulate(arm, 2.4, initial=arm.rest([0.3]), prescribed={1: swing}, rate=200.0)
fa.animate(run, "whip.html", channels=[], torque=False, speed=0.5)
