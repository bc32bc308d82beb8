"""Arms for tests of changes during a run."""

import numpy as np

import flexarm as fa

LENGTH, MASS = 2.0, 0.2
INERTIA = 0.3 * LENGTH**3 / 3.0 + MASS * LENGTH**2
ROD = {"flexural_rigidity": 105.0, "mass_per_length": 0.6}


def rigid_link(**joint):
    link = fa.Link(length=LENGTH, flexible=False, mass_per_length=0.3)
    return fa.Arm(links=[link], joints=[fa.Joint(**joint)], payload=fa.Payload(mass=MASS))


def two_links(offset=(0.0, 0.0), **spec):
    gauges = [fa.Gauge(station=0.05, distance=0.005)]
    links = [
        fa.Link(length=1.4, elements=2, gauges=gauges, **ROD),
        fa.Link(length=1.0, elements=1, gauges=gauges, **ROD),
    ]
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.1)]
    return fa.Arm(links=links, joints=joints, payload=fa.Payload(mass=0.1, offset=offset), **spec)


def moving(arm, seed=3):
    """Return coordinates and rates of an arm in motion, with bent links."""
    rng = np.random.default_rng(seed)
    q, qd = 0.02 * rng.normal(size=arm.dof), 0.1 * rng.normal(size=arm.dof)
    q[arm.joint_index], qd[arm.joint_index] = [0.4, 0.9], [0.8, -0.5]
    return q, qd


def with_payload(arm, **numbers):
    return arm.spec.replace(payload=arm.spec.payload.replace(**numbers))
