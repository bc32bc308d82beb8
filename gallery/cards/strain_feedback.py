"""Strain feedback

Stiff joints leave the links ringing; feedback of two strain gauges damps them.

[Damp vibration](../how-to/damp-vibration.md)
"""

import flexarm as fa

rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732, "elements": 1}
gauge = fa.Gauge(station=0.05, distance=0.005)
arm = fa.Arm(
    links=[
        fa.Link(length=1.4142, gauges=[gauge], **rod),
        fa.Link(length=1.0, gauges=[gauge], **rod),
    ],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)],
    theory="second_order",
)
turn = fa.joint_motion(arm, start=[0.0, 0.5], end=[0.6, 0.1], duration=1.0)
laws = {
    "joint PD": fa.JointPD([400.0, 100.0], [40.0, 6.0]),
    "strain feedback": fa.StrainFeedback([400.0, 100.0], [40.0, 6.0], strain=[1e5, 3e4]),
}
runs = {n: fa.simulate(arm, 5.0, controller=law, reference=turn) for n, law in laws.items()}
look = {"channels": "link_tip_deflection[1]", "torque": False, "trace": False}
fa.animate(runs, "strain_feedback.html", **look)
