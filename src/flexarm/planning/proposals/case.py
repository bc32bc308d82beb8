"""The test case of a proposal: motion, disturbance, surface, plants and run, as in a study file."""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.integrate.base import FloatArray
from flexarm.linear import equilibrium
from flexarm.model import Load
from flexarm.planning.proposals.requirements import Requirements, rounded

#: Depth of the tip in the surface of the force task, relative to the length of the arm, and the
#: relative damping times this length and the lowest frequency.
_SURFACE_DEPTH, _SURFACE_DAMPING = 3e-4, 9.0
#: Deflection of the tip under the disturbance of the task "hold", relative to the length of the
#: arm, if the joints did not move.
_DISTURBED = 0.01
#: Noise of the instruments of the tip, relative to the length of the arm, and of the force,
#: relative to that of the task.
_TIP_NOISE, _FORCE_NOISE = 5e-5, 4e-3
#: Time before the motion in periods of the lowest frequency; with a force, which is zero at the
#: start; and time after the motion.
_BEFORE, _BEFORE_PRESSED, _AFTER = 0.2, 2.0, 3.0
#: Recorded samples in a period of the lowest frequency.
_RATE = 150.0


def case_of(needs: Requirements) -> dict[str, Any]:
    """Return the content of a study without drives: the keys of a file, for all candidates."""
    found: dict[str, Any] = {"arm": needs.arm.spec, "motions": {needs.task: _motion(needs)}}
    if needs.task == "hold" and needs.lowest:
        found["loads"] = [_disturbance(needs)]
    if needs.task == "force":
        found["contacts"] = [_surface(needs)]
    hardware: dict[str, Any] = {}
    if {"tip", "force"} & needs.sensors:
        hardware["instruments"] = _instruments(needs)
    if needs.torque_limit is not None:
        hardware["motors"] = {"torque_limit": rounded(needs.torque_limit)}
    if hardware:
        found["hardware"] = hardware
    found["plants"] = plants_of(needs)
    motion = found["motions"][needs.task]
    moved = motion.get("path", motion)
    end = moved["start_time"] + moved["duration"]
    after = 0.0 if needs.task in ("hold", "force") else float(f"{_AFTER * needs.period:.2g}")
    settling = float(f"{after / _AFTER:.2g}")
    (duration,), (rate,) = rounded([end + after], 6), rounded([_RATE / needs.period], 1)
    found["run"] = {"duration": duration, "rate": rate, "settling": settling}
    return found


def _motion(needs: Requirements) -> dict[str, Any]:
    start, end = rounded(needs.start, 6), rounded(needs.end, 6)
    periods = _BEFORE_PRESSED if needs.task == "force" else _BEFORE
    before = float(f"{periods * needs.period:.2g}")
    times = {"duration": needs.motion_time, "start_time": before}
    if not needs.of_tip:
        return {"kind": "joint", "start": start, "end": end, **times}
    line = {"kind": "line", "start": start, "end": end, **times}
    if needs.task == "track":
        return line
    return {"kind": "pressed", "path": line, "force": needs.force}


def _surface(needs: Requirements) -> dict[str, Any]:
    """Return the wall along the line of the tip; the base is on its free side."""
    along = needs.end - needs.start
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    if normal @ needs.start > 0.0:  # it points away from the base
        normal = -normal
    reach = float(np.sum(needs.arm.lengths))
    stiffness = needs.force / (_SURFACE_DEPTH * reach)
    damping = _SURFACE_DAMPING * needs.period / (2.0 * np.pi * reach)
    return {
        "surface": {
            "kind": "wall",
            "point": rounded(needs.start, 6),
            "normal": rounded(normal, 6),
        },
        "stiffness": rounded([stiffness], 2)[0],
        "damping": rounded([damping], 2)[0],
    }


def _disturbance(needs: Requirements) -> dict[str, Any]:
    """Return a push across the last link at the tip, for one period after the start."""
    arm, links = needs.arm, len(needs.arm.spec.links)
    still = equilibrium(arm, needs.start)
    across = _across(needs)
    pushed = equilibrium(arm, needs.start, loads=[Load(links, tuple(across.tolist()))])
    compliance = np.hypot(*(arm.tip(pushed.q)[:2] - arm.tip(still.q)[:2]))
    force = rounded(across * _DISTURBED * float(np.sum(arm.lengths)) / compliance)
    before, period = _BEFORE * needs.period, needs.period
    times = rounded([before, before, before + period, before + period])
    factor = {"times": times, "values": [0.0, 1.0, 1.0, 0.0]}
    return {"link": links, "force": force, "factor": factor}


def _across(needs: Requirements) -> FloatArray:
    """Return the unit vector (2,) across the last link."""
    angle = float(needs.arm.tip(needs.arm.rest(needs.start))[2])
    return np.array([-np.sin(angle), np.cos(angle)])


def _instruments(needs: Requirements) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = [{"signal": "joint_angle"}, {"signal": "joint_rate"}]
    if "gauges" in needs.sensors:
        found.append({"signal": "strain"})
    if "tip" in needs.sensors:
        noise = rounded([_TIP_NOISE * float(np.sum(needs.arm.lengths))], 2)[0]
        found.append({"signal": "tip", "noise": noise})
    if "force" in needs.sensors:
        noise = rounded([_FORCE_NOISE * needs.force], 2)[0]
        found.append({"signal": "contact_force", "noise": noise})
    return found


def plants_of(needs: Requirements) -> dict[str, dict[str, Any]]:
    """Return the plants of a study that differ from the model as far as the uncertainty permits.

    Names have the differences in words; the first plant is the model.
    """
    found: dict[str, dict[str, Any]] = {"nominal": {}}
    heavy = {"payload_factor": 1.0 + needs.payload}
    light = {"payload_factor": max(0.0, 1.0 - needs.payload)}
    soft = {"flexural_rigidity_factor": 1.0 - needs.rigidity}
    stiff = {"flexural_rigidity_factor": 1.0 + needs.rigidity}
    if needs.payload and needs.rigidity:
        found["heavy, soft"] = heavy | soft
        found["light, stiff"] = light | stiff
        found["heavy, stiff"] = heavy | stiff
        found["light, soft"] = light | soft
    elif needs.payload:
        found |= {"heavy": heavy, "light": light}
    elif needs.rigidity:
        found |= {"soft": soft, "stiff": stiff}
    return found
