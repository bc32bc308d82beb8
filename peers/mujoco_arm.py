"""A case in MuJoCo: rigid bars joined by hinges with torsional springs."""

from __future__ import annotations

from collections.abc import Callable
from xml.etree.ElementTree import Element, SubElement, tostring

import mujoco
import numpy as np
from mujoco import rollout

from peers.arms import Case, steps_per_sample
from peers.bars import Bar, angles, bars

_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


def tip(case: Case, segments: int, step: float) -> np.ndarray:
    """Return the tip's path (samples, 2), m; see ``prepare``."""
    return prepare(case, segments, step)()


def prepare(case: Case, segments: int, step: float) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it and gives the tip's path (samples, 2), m.

    Each link is cut into ``segments`` as in ``bars``. Fixed steps of ``step`` seconds, taken by
    MuJoCo's own loop, which calls no Python. It raises ``RuntimeError`` where the motion
    became unstable: the step is too long for the stiffest spring.
    """
    model = mujoco.MjModel.from_xml_string(_description(case, segments, step))
    data = mujoco.MjData(model)
    data.qpos[:] = angles(case, segments)
    start = np.empty(mujoco.mj_stateSize(model, _STATE))
    mujoco.mj_getState(model, data, start, _STATE)
    count = steps_per_sample(case, step)
    # A sensor tells where the tip was when the step began: one step more tells of the end.
    steps = (case.samples - 1) * count + 1
    # Held over a step at its middle value: the impulse is right to second order in a step that
    # stability keeps far shorter than the torque's period.
    torques = np.array([case.torque((number + 0.5) * step) for number in range(steps)])

    def run() -> np.ndarray:
        data.warning.number[:] = 0
        _, sensed = rollout.rollout(model, data, start[None], torques[None])
        # An unstable motion is put back to its start and goes on, with no more than a warning.
        if data.warning.number.any():
            raise RuntimeError(
                f"MuJoCo became unstable with {segments} segments and step {step} s."
            )
        return np.array(sensed[0, ::count, :2])

    return run


def rollouts(
    case: Case, segments: int, step: float, starts: np.ndarray, threads: int
) -> np.ndarray:
    """Integrate from many joint angles (runs, joints), rad; return the tips (runs, samples, 2), m.

    ``prepare`` describes one run. MuJoCo's own threads share the runs.
    """
    model = mujoco.MjModel.from_xml_string(_description(case, segments, step))
    datas = [mujoco.MjData(model) for _ in range(threads)]
    states = np.empty((len(starts), mujoco.mj_stateSize(model, _STATE)))
    for state, joint_angles in zip(states, starts, strict=True):
        datas[0].qpos[:] = 0.0
        datas[0].qpos[:: segments + 1] = joint_angles  # the hinges at the motors
        mujoco.mj_getState(model, datas[0], state, _STATE)
    count = steps_per_sample(case, step)
    steps = (case.samples - 1) * count + 1
    torques = np.array([case.torque((number + 0.5) * step) for number in range(steps)])
    _, sensed = rollout.rollout(
        model, datas, states, np.broadcast_to(torques, (len(starts), *torques.shape))
    )
    if any(data.warning.number.any() for data in datas):
        raise RuntimeError(f"MuJoCo became unstable with {segments} segments and step {step} s.")
    return np.array(sensed[:, ::count, :2])


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
    motors = SubElement(root, "actuator")
    for bar in bars(case, segments):
        body = _add_bar(body, bar)
        if bar.link is not None:
            SubElement(motors, "motor", joint=f"joint{bar.link}")
    SubElement(body, "site", name="tip", pos=f"{bar.length!r} 0 0")
    SubElement(SubElement(root, "sensor"), "framepos", objtype="site", objname="tip")
    return tostring(root, encoding="unicode")


def _add_bar(parent: Element, bar: Bar) -> Element:
    """Hinge a bar to its parent."""
    body = SubElement(parent, "body", pos=f"{bar.offset!r} 0 0")
    joint = SubElement(body, "joint", type="hinge", axis="0 0 1", stiffness=repr(bar.spring))
    if bar.link is not None:
        joint.set("name", f"joint{bar.link}")
    # MuJoCo wants inertia about the bar's own axis too; nothing turns about it in a plane.
    SubElement(
        body,
        "inertial",
        pos=f"{bar.length / 2!r} 0 0",
        mass=repr(bar.mass),
        diaginertia=" ".join([repr(bar.inertia)] * 3),
    )
    return body
