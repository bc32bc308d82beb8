"""LQG beside PD

Both follow a line; the regulator reads the strain of the links and leaves no vibration.

[Control with linear models](../how-to/control-linear.md)
"""

import flexarm as fa

rod = {
    "flexural_rigidity": 105.0,
    "mass_per_length": 0.61732,
    "damping": fa.ModalDamping(ratio=0.01),
}
rod |= {"gauges": [fa.Gauge(station=0.05, distance=0.005)]}
arm = fa.Arm(
    links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
    joints=[fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02)],
)
line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.0, start_time=0.3)
design = {"acceptable": {"tip": 0.001, "joint_rate": 0.3}, "schedule": [None, [-1.2, -0.9, -0.6]]}
laws = {
    "joint PD": fa.JointPD([40.0, 10.0], [20.0, 3.0], feedforward=fa.rigid_torque(arm, line)),
    "LQG": fa.LQG(arm, **design),
}
runs = {n: fa.simulate(arm, 2.5, controller=law, reference=line) for n, law in laws.items()}
look = {"channels": "link_tip_deflection[1]", "torque": False, "speed": 0.7}
fa.animate(runs, "lqg.html", reference=line, **look)
