"""Input shaping

A shaped motion takes a period longer and leaves no vibration.

[Shape a motion](../how-to/shape-a-motion.md)
"""

import flexarm as fa

beam = fa.Link(length=1.0, flexural_rigidity=60.0, mass_per_length=0.4, elements=2)
arm = fa.Arm(
    links=[beam],
    joints=[fa.Joint(hub_inertia=0.2)],
    payload=fa.Payload(mass=0.3),
    theory="second_order",
)
plain = fa.joint_motion(arm, [0.5], [1.6], duration=0.55, start_time=0.1)
stiff = fa.JointPD([2000.0], [120.0])
runs = {
    name: fa.simulate(arm, 2.0, controller=stiff, reference=motion, rate=300.0)
    for name, motion in {"plain": plain, "shaped": fa.shaped(plain, arm, "zvd")}.items()
}
fa.animate(
    runs,
    "shaping.html",
    speed=0.5,
    channels="link_tip_deflection",
    torque=False,
    trace=False,
)
