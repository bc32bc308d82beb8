"""Arm of the paper

Two links follow a line with the torques of the rigid arm: they bend, miss the line and ring.

[Your first run](../tutorials/first-run.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
arm = fa.Arm(
    links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
    payload=fa.Payload(mass=0.2),
    theory="second_order",
)
line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.0)
run = fa.simulate(arm, 1.8, torque=fa.rigid_torque(arm, line), rate=500.0)
fa.animate(
    run,
    "paper.html",
    reference=line,
    channels="link_tip_deflection",
    torque=False,
    speed=0.5,
)
