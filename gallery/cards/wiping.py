"""Wiping a wall

The tip presses on a wall with a prescribed force while it slides along it.

[Press on a surface](../how-to/control-force.md)
"""

import numpy as np

import flexarm as fa

rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
rod |= {"damping": fa.ModalDamping(ratio=0.01)}
arm = fa.Arm(
    links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)],
    payload=fa.Payload(mass=0.1),
)
up = fa.line_motion(arm, (1.5, 0.0), (1.5, 1.2), duration=3.0, start_time=0.3)
wiping = fa.pressed_motion(
    arm, up, lambda t: 5.0 - 2.0 * np.cos(np.pi * t), normal=(-1.0, 0.0), friction=0.2
)
wall = fa.Contact(fa.Wall((1.5, 0.0), (-1.0, 0.0)), stiffness=1e4, damping=0.5, friction=0.2)
drive = {"controller": fa.HybridForce(arm), "reference": wiping, "initial": wiping.initial}
run = fa.simulate(arm, 3.6, contacts=[wall], **drive)
look = {"channels": "contact_force", "torque": False, "trace": False}
fa.animate(run, "wiping.html", contacts=[wall], reference=up, **look)
