"""Motions of the joints and of the tip, inverse kinematics, and the rigid torques along them."""

from flexarm.motion.dynamics.rigid_torques import RigidTorque, rigid_torque
from flexarm.motion.geometry.inverse_kinematics import inverse_kinematics
from flexarm.motion.motion import JointMotion, JointState, Motion, joint_motion
from flexarm.motion.sampled import SampledMotion
from flexarm.motion.shaping import ShapedMotion
from flexarm.motion.smoothing import SmoothedMotion, smoothed
from flexarm.motion.timing import TIMING_LAWS, TimingLaw, quintic, trapezoidal
from flexarm.motion.tip.path_motions import (
    circle_motion,
    line_motion,
    spline_motion,
    via_point_motion,
)
from flexarm.motion.tip.tip_motion import TipMotion

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
