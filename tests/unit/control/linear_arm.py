"""Arm and weights for tests of linear controllers."""

from arms import chain

POSTURE = [0.4, 0.9]


def arm_with_gauges(**options):
    rod = {"flexural_rigidity": [40.0, 25.0], "mass_per_length": 0.5, "elements": 1}
    joints = [0.1, {"mass": 0.4, "hub_inertia": 0.05}]
    return chain((0.8, 0.6), joints, damping=0.01, gauge=(0.05, 0.004), **rod, **options)
