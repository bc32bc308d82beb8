"""A case in Pinocchio: rigid bars on springs, its recursion called from a loop in Python."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio

from peers.arms import Case, steps_per_sample
from peers.bars import angles, bars, motors


def tip(case: Case, segments: int, step: float) -> np.ndarray:
    """Return the tip's path (samples, 2), m; see ``prepare``."""
    return prepare(case, segments, step)()


def prepare(case: Case, segments: int, step: float) -> Callable[[], np.ndarray]:
    """Build the model; return what integrates it and gives the tip's path (samples, 2), m.

    Each link is cut into ``segments`` as in ``bars``. Pinocchio has no integrators: the classical
    method of Runge and Kutta is written here, with fixed steps of ``step`` s. It raises
    ``RuntimeError`` where the motion became unstable.
    """
    model, tip_frame = _model(case, segments)
    data = model.createData()
    springs = np.array([bar.spring for bar in bars(case, segments)])
    count = steps_per_sample(case, step)
    start = angles(case, segments)
    # At the begin, the middle and the end of each step.
    times = 0.5 * step * np.arange(2 * count * (case.samples - 1) + 1)
    wave = np.array([case.wave(t) for t in times])
    torques = np.multiply.outer(wave, motors(case, segments))
    aba = pinocchio.aba

    def run() -> np.ndarray:
        q, qd = start.copy(), np.zeros(model.nv)
        path = np.empty((case.samples, 2))
        path[0] = _place(model, data, q, tip_frame)
        number = 0
        for sample in range(1, case.samples):
            for _ in range(count):
                first, middle, last = torques[number : number + 3]
                number += 2
                a1 = aba(model, data, q, qd, first - springs * q)
                q2, v2 = q + 0.5 * step * qd, qd + 0.5 * step * a1
                a2 = aba(model, data, q2, v2, middle - springs * q2)
                q3, v3 = q + 0.5 * step * v2, qd + 0.5 * step * a2
                a3 = aba(model, data, q3, v3, middle - springs * q3)
                q4, v4 = q + step * v3, qd + step * a3
                a4 = aba(model, data, q4, v4, last - springs * q4)
                q = q + step / 6.0 * (qd + 2.0 * (v2 + v3) + v4)
                qd = qd + step / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)
            path[sample] = _place(model, data, q, tip_frame)
            if not np.isfinite(path[sample]).all():
                raise RuntimeError(
                    f"Pinocchio became unstable with {segments} segments and step {step} s."
                )
        return path

    return run


def _model(case: Case, segments: int) -> tuple[pinocchio.Model, int]:
    """Return the chain of bars, and the frame at its tip."""
    model = pinocchio.Model()
    model.gravity.linear = np.array([0.0, -case.gravity, 0.0])
    joint = 0
    for number, bar in enumerate(bars(case, segments)):
        hinge = pinocchio.SE3(np.eye(3), np.array([bar.offset, 0.0, 0.0]))
        joint = model.addJoint(joint, pinocchio.JointModelRZ(), hinge, f"hinge{number}")
        # Inertia about the bar's own axis is required, although nothing turns about it.
        centre = np.array([0.5 * bar.length, 0.0, 0.0])
        body = pinocchio.Inertia(bar.mass, centre, bar.inertia * np.eye(3))
        model.appendBodyToJoint(joint, body, pinocchio.SE3.Identity())
    end = pinocchio.SE3(np.eye(3), np.array([bar.length, 0.0, 0.0]))
    kind = pinocchio.FrameType.OP_FRAME
    return model, model.addFrame(pinocchio.Frame("tip", joint, end, kind))


def _place(model: pinocchio.Model, data: pinocchio.Data, q: np.ndarray, frame: int) -> np.ndarray:
    pinocchio.forwardKinematics(model, data, q)
    return np.array(pinocchio.updateFramePlacement(model, data, frame).translation[:2])
