"""Gymnasium environments in which a learning agent controls a flexible arm.

Importing this module registers ``flexarm/Reach-v0``, ``flexarm/TrackPath-v0`` and
``flexarm/TrackForce-v0``. Needs the extra ``gym``.
"""

from __future__ import annotations

try:
    import gymnasium
except ImportError:
    reported = (
        "flexarm.bridges.gymnasium_env needs Gymnasium: pip install 'flexarm[gym]' brings it."
    )
    raise ImportError(reported) from None

from flexarm.bridges.gymnasium_env.base import ArmEnv, laboratory_arm
from flexarm.bridges.gymnasium_env.tasks import ReachEnv, TrackForceEnv, TrackPathEnv
from flexarm.bridges.gymnasium_env.vector import ArmVectorEnv, ReachVectorEnv, TrackPathVectorEnv

__all__ = [
    "ENVIRONMENTS",
    "VECTOR_ENVIRONMENTS",
    "ArmEnv",
    "ArmVectorEnv",
    "ReachEnv",
    "ReachVectorEnv",
    "TrackForceEnv",
    "TrackPathEnv",
    "TrackPathVectorEnv",
    "laboratory_arm",
]

#: All environments by the names registered with Gymnasium.
ENVIRONMENTS: dict[str, type[ArmEnv]] = {
    "flexarm/Reach-v0": ReachEnv,
    "flexarm/TrackPath-v0": TrackPathEnv,
    "flexarm/TrackForce-v0": TrackForceEnv,
}

#: Vector environments by the same names. The others are vectorized by Gymnasium.
VECTOR_ENVIRONMENTS: dict[str, type[ArmVectorEnv]] = {
    "flexarm/Reach-v0": ReachVectorEnv,
    "flexarm/TrackPath-v0": TrackPathVectorEnv,
}

for _name, _kind in ENVIRONMENTS.items():
    _vector = VECTOR_ENVIRONMENTS.get(_name)
    # Episodes have their own limit in seconds, so no limit in steps is registered.
    gymnasium.register(
        _name,
        entry_point=f"{_kind.__module__}:{_kind.__name__}",
        vector_entry_point=f"{_vector.__module__}:{_vector.__name__}" if _vector else None,
    )
