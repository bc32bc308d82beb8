"""Dropping a payload

The gripper opens on the way: the links spring back and ring.

[Change the arm](../how-to/change-the-arm.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 800.0, "mass_per_length": 0.61732}
rod |= {"damping": fa.ModalDamping(ratio=0.01)}
arm = fa.Arm(
    links=[fa.Link(length=1.4, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)],
    payload=fa.Payload(mass=1.0),
    gravity=(0.0, -9.81),
)
lift = fa.joint_motion(arm, [0.3, -0.9], [1.0, -1.1], 1.5)
drives = fa.JointPD([200.0, 80.0], [40.0, 8.0], feedforward=fa.rigid_torque(arm, lift))
drop = fa.Change("payload.mass", at=1.0, to=0.0)
start = fa.equilibrium(arm, [0.3, -0.9]).q
run = fa.simulate(arm, 2.5, controller=drives, reference=lift, initial=start, changes=[drop])
look = {"channels": "link_tip_deflection", "torque": False, "trace": False}
fa.animate(run, "drop.html", speed=0.5, **look)
