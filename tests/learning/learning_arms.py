"""Arms, motions and feedback of the tests of learning."""

import flexarm as fa
from arms import chain

SAMPLE_TIME = 1e-3


def two_links(payload=0.1, rigidity=1.0):
    """Return a flexible arm whose slowest vibration with locked joints has 3.6 Hz."""
    rod = {"flexural_rigidity": [60.0 * rigidity, 30.0 * rigidity], "mass_per_length": [0.6, 0.4]}
    joints = [fa.Joint(hub_inertia=inertia, damping=0.05) for inertia in (0.1, 0.05)]
    return chain((0.6, 0.5), joints, damping=0.02, payload=payload, elements=1, **rod)


def swing(arm, size=1.0, duration=0.8):
    """Return a motion of both joints by up to 0.9 rad."""
    return fa.joint_motion(arm, [0.2, -0.4], [0.2 + 0.7 * size, -0.4 + 0.9 * size], duration)


def feedback(arm, motion):
    """Return a controller that follows a motion with the torques of the rigid model."""
    torque = fa.rigid_torque(arm, motion)
    return fa.JointPD([20.0, 8.0], [3.0, 0.8], feedforward=torque, sample_time=SAMPLE_TIME)


def one_rigid_link():
    """Return an arm of one rigid link with the inertia 0.25 kg m^2, without gravity."""
    link = fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=0.3, elements=1)
    return fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.15)]).rigid()
