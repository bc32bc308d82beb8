"""Identification

A model with the printed numbers leaves the record of the bench; the identified one follows it.

[Identify an arm](../how-to/identify-an-arm.md)
"""

import flexarm as fa


def bench(rigidity, mass):
    link = {"flexural_rigidity": rigidity, "mass_per_length": 0.4, "elements": 2}
    gauge = fa.Gauge(station=0.05, distance=0.005)
    return fa.Arm(
        links=[fa.Link(length=1.0, gauges=[gauge], **link)],
        joints=[fa.Joint(hub_inertia=0.1)],
        payload=fa.Payload(mass=mass),
    )


model, arm = bench(120.0, 0.2), bench(80.0, 0.4)
turn = fa.joint_motion(model, [0.3], [1.8], duration=0.6)
drive = {"controller": fa.JointPD([100.0], [10.0]), "reference": turn}
measured = fa.simulate(arm, 1.5, rate=200.0, **drive)
record = fa.MeasuredRecord(measured, outputs=["joint_angle", "strain"], **drive)
fit = fa.identify(model, record, ["links[0].flexural_rigidity", "payload.mass"])
runs = {
    n: fa.simulate(a, 1.5, **drive) for n, a in {"data sheet": model, "identified": fit.arm}.items()
}
look = {"channels": "link_tip_deflection", "torque": False, "trace": False}
fa.animate(runs, "identification.html", rigid=measured, speed=0.5, **look)
