"""Spin-up

A beam is spun up: it lags, then centrifugal force straightens it.

[Validation: spin-up](../gallery/motion.md)
"""

import numpy as np

import flexarm as fa

beam = fa.Link(length=10.0, flexural_rigidity=1.4e4, mass_per_length=1.2, elements=8, modes=4)
arm = fa.Arm(links=[beam], theory="second_order")
spin, ramp = 6.0, 15.0  # rad/s, s
w = 2.0 * np.pi / ramp


def angle(t):
    return (
        spin / ramp * (t**2 / 2 + (np.cos(w * t) - 1) / w**2) if t < ramp else spin * (t - ramp / 2)
    )


def rate(t):
    return spin / ramp * (t - np.sin(w * t) / w) if t < ramp else spin


turn = fa.PrescribedAngle(angle, rate, lambda t: spin / ramp * (1 - np.cos(w * t)) * (t < ramp))
run = fa.simulate(arm, 20.0, prescribed={1: turn}, rate=60.0)
look = {"channels": "link_tip_deflection", "torque": False, "trace": False, "magnify": 4.0}
fa.animate(run, "spin_up.html", speed=2.0, **look)
