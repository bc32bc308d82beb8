"""Motions of the joints and of the tip, inverse kinematics, and the rigid torques along them."""

from flexarm.motion.dynamics.dynamics_along import RigidTorque, rigid_torque
from flexarm.motion.geometry.inverse_kinematics import inverse_kinematics
from flexarm.motion.motion import (
    TIMING_LAWS,
    JointMotion,
    JointState,
    Motion,
    SampledMotion,
    TimingLaw,
    joint_motion,
    quintic,
    trapezoidal,
)
from flexarm.motion.shaping import ShapedMotion, SmoothedMotion, smoothed
from flexarm.motion.tip.tip_motion import (
    TipMotion,
    circle_motion,
    line_motion,
    spline_motion,
    via_point_motion,
)

__all__ = [
    "TIMING_LAWS",
    "JointMotion",
    "JointState",
    "Motion",
    "RigidTorque",
    "SampledMotion",
    "ShapedMotion",
    "SmoothedMotion",
    "TimingLaw",
    "TipMotion",
    "circle_motion",
    "inverse_kinematics",
    "joint_motion",
    "line_motion",
    "quintic",
    "rigid_torque",
    "smoothed",
    "spline_motion",
    "trapezoidal",
    "via_point_motion",
]
