"""Learning over trials

Six trials with a wrong model, and the tip follows the motion.

[Learn over trials](../how-to/repeat-a-motion.md)
"""

import flexarm as fa


def two_links(payload, softer=1.0):
    damped = {"damping": fa.ModalDamping(ratio=0.02), "elements": 1, "mass_per_length": 0.5}
    links = [
        fa.Link(length=0.6, flexural_rigidity=60.0 * softer, **damped),
        fa.Link(length=0.5, flexural_rigidity=30.0 * softer, **damped),
    ]
    joints = [fa.Joint(hub_inertia=0.1, damping=0.05), fa.Joint(hub_inertia=0.05, damping=0.05)]
    return fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=payload))


model, arm = two_links(0.1), two_links(0.3, softer=0.8)
motion = fa.joint_motion(model, [0.2, -0.4], [1.4, 0.7], 0.8)
pd = fa.JointPD([20.0, 8.0], [3.0, 0.8], feedforward=fa.rigid_torque(model, motion))
learned = fa.iterative_learning(
    model, motion, pd, duration=1.0, interval=0.01, effort=1e-4, trials=6, plant=arm
)
runs = {
    name: fa.simulate(arm, 1.0, controller=law, reference=motion, rate=500.0)
    for name, law in {"first trial": pd, "after six": learned.controller}.items()
}
fa.animate(runs, "learning.html", reference=motion, channels=[], torque=False, speed=0.4)
