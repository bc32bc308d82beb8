"""Boom under gravity

A crane arm lifts 150 kg: it sags, and swings after the lift.

[A boom from its data sheet](../tutorials/boom.md)
"""

import flexarm as fa

links = [
    fa.Link(length=4.0, flexural_rigidity=4e5, mass_per_length=45.0, modes=2),
    fa.Link(length=3.0, flexural_rigidity=1.5e5, mass_per_length=28.0, modes=2),
]
joints = [fa.Joint(hub_inertia=400.0), fa.Joint(mass=40.0, hub_inertia=100.0)]
arm = fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=150.0), gravity=(0.0, -9.81))
lift = fa.joint_motion(arm, [0.2, -0.6], [1.0, -1.4], duration=2.0, start_time=0.3)
drives = fa.JointPD([2e5, 5e4], [4e4, 1e4], feedforward=fa.rigid_torque(arm, lift))
start = fa.equilibrium(arm, [0.2, -0.6]).q
run = fa.simulate(arm, 4.5, controller=drives, reference=lift, initial=start, rate=200.0)
fa.animate(run, "boom.html", channels="link_tip_deflection", torque=False)
