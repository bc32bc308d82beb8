"""A case in MuJoCo: rigid bars joined by hinges with torsional springs."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np

from peers.arms import Case, steps_per_sample


def tip(case: Case, segments: int, step: float) -> np.ndarray:
    """Return the tip's path (samples, 2), m.

    A spring in the middle of each of ``segments`` equal pieces of a link stands for that piece's
    bending: the error falls with the square of the piece's length. Fixed steps of ``step`` seconds.

    Raises:
        RuntimeError: the motion became unstable, the step is too long for the stiffest spring.
    """
    model = mujoco.MjModel.from_xml_string(_description(case, segments, step))
    data = mujoco.MjData(model)
    # A link has one joint of its own and one for each spring.
    joints = np.arange(len(case.lengths)) * (segments + 1)
    data.qpos[joints] = case.joint_angles
    mujoco.mj_forward(model, data)
    path = np.empty((case.samples, 2))
    path[0] = data.site("tip").xpos[:2]
    count = steps_per_sample(step)
    for sample in range(1, case.samples):
        for _ in range(count):
            # Held over a step at its middle value: the impulse is right to second order in a step
            # that stability keeps far shorter than the torque's period.
            data.qfrc_applied[joints] = case.torque(data.time + step / 2)
            mujoco.mj_step(model, data)
        # Positions of points are those at the start of the last step until asked for.
        mujoco.mj_kinematics(model, data)
        path[sample] = data.site("tip").xpos[:2]
        # An unstable motion is put back to its start and goes on, with no more than a warning.
        if any(warning.number for warning in data.warning):
            raise RuntimeError(
                f"MuJoCo became unstable with {segments} segments and step {step} s."
            )
    return path


def limit(coarse: np.ndarray, fine: np.ndarray) -> np.ndarray:
    """Return the path that infinitely many segments tend to, from one with n and one with 2 n.

    The error has even powers of the segment's length only; this removes the square (Richardson).
    """
    return fine + (fine - coarse) / 3.0


def _description(case: Case, segments: int, step: float) -> str:
    """Write the model in MuJoCo's format."""
    root = Element("mujoco")
    SubElement(root, "compiler", angle="radian")
    gravity = f"0 {-case.gravity!r} 0"
    option = SubElement(root, "option", timestep=repr(step), integrator="RK4", gravity=gravity)
    SubElement(option, "flag", contact="disable")
    body = SubElement(root, "worldbody")
    offset = 0.0
    for length in case.lengths:
        piece = length / segments
        spring = case.flexural_rigidity / piece
        body = _bar(body, offset, piece / 2, case.mass_per_length, 0.0)
        offset = piece / 2
        for number in range(segments):
            bar = piece if number < segments - 1 else piece / 2
            body = _bar(body, offset, bar, case.mass_per_length, spring)
            offset = bar
    SubElement(body, "site", name="tip", pos=f"{offset!r} 0 0")
    return tostring(root, encoding="unicode")


def _bar(parent: Element, offset: float, length: float, density: float, spring: float) -> Element:
    """Hinge a uniform thin bar to its parent, ``offset`` along the parent's axis."""
    body = SubElement(parent, "body", pos=f"{offset!r} 0 0")
    SubElement(body, "joint", type="hinge", axis="0 0 1", stiffness=repr(spring))
    mass = density * length
    inertia = mass * length**2 / 12
    # MuJoCo wants inertia about the bar's own axis too; nothing turns about it in a plane.
    SubElement(
        body,
        "inertial",
        pos=f"{length / 2!r} 0 0",
        mass=repr(mass),
        diaginertia=f"{inertia!r} {inertia!r} {inertia!r}",
    )
    return body
