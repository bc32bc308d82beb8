"""Arm and weights for tests of linear controllers."""

import flexarm as fa

POSTURE = [0.4, 0.9]


def arm_with_gauges(**options):
    links = [
        fa.Link(
            length=length,
            flexural_rigidity=rigidity,
            mass_per_length=0.5,
            elements=1,
            damping=fa.ModalDamping(ratio=0.01),
            gauges=[fa.Gauge(station=0.05, distance=0.004)],
        )
        for length, rigidity in ((0.8, 40.0), (0.6, 25.0))
    ]
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.4, hub_inertia=0.05)]
    return fa.Arm(links=links, joints=joints, **options)
