"""Motions of the joints and of the tip, inverse kinematics, and the rigid torques along them."""

from flexarm.motion.dynamics.dynamics_along import rigid_torque as rigid_torque
from flexarm.motion.geometry.inverse_kinematics import inverse_kinematics as inverse_kinematics
from flexarm.motion.motion import JointState as JointState
from flexarm.motion.motion import Motion as Motion
from flexarm.motion.motion import joint_motion as joint_motion
from flexarm.motion.shaping import smoothed as smoothed
from flexarm.motion.timing import TIMING_LAWS as TIMING_LAWS
from flexarm.motion.timing import TimingLaw as TimingLaw
from flexarm.motion.timing import quintic as quintic
from flexarm.motion.timing import trapezoidal as trapezoidal
from flexarm.motion.tip.tip_motion import circle_motion as circle_motion
from flexarm.motion.tip.tip_motion import line_motion as line_motion
from flexarm.motion.tip.tip_motion import spline_motion as spline_motion
from flexarm.motion.tip.tip_motion import via_point_motion as via_point_motion
