"""Requirements of proposals for two arms, with the defaults of ``fa.design``."""

from __future__ import annotations

import flexarm as fa
from arms import chain
from flexarm.planning.proposals.requirements import requirements_of

DEFAULTS = {
    "sensors": None,
    "computing": "medium",
    "payload_uncertainty": 0.0,
    "rigidity_uncertainty": 0.0,
    "start": None,
    "end": None,
    "duration": None,
    "torque_limit": None,
    "hardware": None,
    "force": 5.0,
    "disk_margin": 0.4,
}


def one_link(**joint):
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    joints = [fa.Joint(hub_inertia=0.05, **joint)]
    return chain([0.8], joints, gauge=(0.02, 0.004), payload=0.1, **rod)


def two_links(gauges=True):
    rod = {"flexural_rigidity": [40.0, 25.0], "mass_per_length": 0.5, "elements": 1}
    more = {"damping": 0.01, "payload": 0.1, "gauge": (0.02, 0.004) if gauges else None}
    return chain((0.8, 0.6), [0.05, 0.03], **rod, **more)


def needs_of(arm, task, **options):
    return requirements_of(arm, task, **(DEFAULTS | options))
