"""Table of docs/performance/controllers.md: damping laws along a motion of the flexible arm.

python docs/performance/measure_damping.py
"""

from __future__ import annotations

import numpy as np

import flexarm as fa

LAWS = fa.PositivePositionFeedback, fa.IntegralResonantControl, fa.WaveBasedControl


def arm_with_gauges():
    """Return the arm of the page "Damp vibration"."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.61732}
    rod |= {"gauges": [fa.Gauge(station=0.05, distance=0.005)]}
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
    )


def row(name, controller, plants, static, line):
    """Return the line of a controller: tip error on its model, and swings in the last second."""
    swings = []
    for plant in plants:
        run = fa.simulate(plant, 4.0, controller=controller, reference=static)
        last = 1e3 * run.tip.sel(time=slice(3.0, None)).values
        swings.append(np.hypot(*(last - last.mean(axis=0)).T).max())
        if plant is plants[0]:
            peak = 1e3 * np.hypot(*(run.tip.values - line.tip(run.time.values)).T).max()
    return (
        f"{name:24} tip error {peak:4.1f} mm, swing {swings[0]:4.2f} mm, 0.7 EI {swings[1]:5.1f} mm"
    )


def tables():
    """Return the table by the name of its part of the page."""
    arm = arm_with_gauges()
    plants = arm, fa.varied(arm, flexural_rigidity_factor=0.7)
    line = fa.line_motion(arm, start=(2.0, 1.0), end=(1.0, 2.0), duration=1.0, start_time=0.3)
    static = fa.quasi_static_reference(arm, line)
    joints = fa.JointPD([400.0, 100.0], [40.0, 6.0], feedforward=static.torque)
    posture = line.joint_angle(0.8)
    controllers = {"joint PD": joints}
    controllers |= {kind.__name__: kind(arm, joints, 0.3, posture=posture) for kind in LAWS}
    rows = (row(name, law, plants, static, line) for name, law in controllers.items())
    yield "damping", "\n".join(rows)


if __name__ == "__main__":
    for _, text in tables():
        print(text)
