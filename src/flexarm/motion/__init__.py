"""Motions of the joints and of the tip, inverse kinematics, and the rigid torques along them."""

from flexarm.motion.lines import LineMotion, line_motion
from flexarm.motion.motion import JointMotion, JointState, Motion, joint_motion
from flexarm.motion.rigid_torques import RigidTorque, rigid_torque
from flexarm.motion.sampled import SampledMotion
from flexarm.motion.shaping import ShapedMotion
from flexarm.motion.smoothing import SmoothedMotion, smoothed
from flexarm.motion.timing import TIMING_LAWS, TimingLaw, quintic, trapezoidal

__all__ = [
    "TIMING_LAWS",
    "JointMotion",
    "JointState",
    "LineMotion",
    "Motion",
    "RigidTorque",
    "SampledMotion",
    "ShapedMotion",
    "SmoothedMotion",
    "TimingLaw",
    "joint_motion",
    "line_motion",
    "quintic",
    "rigid_torque",
    "smoothed",
    "trapezoidal",
]
