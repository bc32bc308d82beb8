"""The case of a task: motion, disturbance, surface, plants and run that candidates share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from flexarm.linear import equilibrium
from flexarm.model import Load
from flexarm.planning.proposals.candidates import Assessed, rounded
from flexarm.planning.proposals.requirements import Requirements

#: Depth of the tip in the surface of the force task, relative to the length of the arm, and the
#: relative damping times this length and the lowest frequency.
_SURFACE_DEPTH, _SURFACE_DAMPING = 3e-4, 9.0
#: Deflection of the tip under the disturbance of the task "hold", relative to the length of the
#: arm, if the joints did not move.
_DISTURBED = 0.01
#: Time before the motion in periods of the lowest frequency; with a force, which is zero at the
#: start; and time after the motion.
_BEFORE, _BEFORE_PRESSED, _AFTER = 0.2, 2.0, 3.0
#: Time after the motion in time constants of the slowest pole of a loop.
_TIME_CONSTANTS = 10.0
#: Longest time, in periods of the lowest frequency, in which integrals may release sticking joints.
_STICKING_PERIODS = 100.0
#: Recorded samples in a period of the lowest frequency.
_RATE = 150.0


def case_of(needs: Requirements) -> dict[str, Any]:
    """Return the content of a study without drives: the keys of a file, for all candidates."""
    content: dict[str, Any] = {"arm": needs.arm.spec, "motions": {needs.task: _motion(needs)}}
    if needs.task == "hold" and needs.lowest:
        # The disturbance is a push across the last link at the tip, for one period.
        arm, links = needs.arm, len(needs.arm.spec.links)
        still = equilibrium(arm, needs.start)
        angle = float(arm.tip(arm.rest(needs.start))[2])
        across = np.array([-np.sin(angle), np.cos(angle)])  # of the last link
        pushed = equilibrium(arm, needs.start, loads=[Load(links, tuple(across.tolist()))])
        compliance = np.hypot(*(arm.tip(pushed.q)[:2] - arm.tip(still.q)[:2]))
        force = rounded(across * _DISTURBED * arm.reach / compliance)
        before, period = _BEFORE * needs.period, needs.period
        times = rounded([before, before, before + period, before + period])
        factor = {"times": times, "values": [0.0, 1.0, 1.0, 0.0]}
        content["loads"] = [{"link": links, "force": force, "factor": factor}]
    if needs.task == "force":
        content["contacts"] = [_surface(needs)]
    content["hardware"] = needs.hardware
    content["plants"] = plants_of(needs)
    motion = content["motions"][needs.task]
    moved = motion.get("path", motion)
    end = moved["start_time"] + moved["duration"]
    after = 0.0 if needs.task in ("hold", "force") else float(f"{_AFTER * needs.period:.2g}")
    settling = float(f"{after / _AFTER:.2g}")
    (duration,), (rate,) = rounded([end + after], 6), rounded([_RATE / needs.period], 1)
    content["run"] = {"duration": duration, "rate": rate, "settling": settling}
    return content


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
    reach = needs.arm.reach
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


def plants_of(needs: Requirements) -> dict[str, dict[str, Any]]:
    """Return plants at the limits of the uncertainty, named by it; the first is the model."""
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


def wait_until_settled(content: dict[str, Any], found: Mapping[str, Assessed]) -> None:
    """Extend the runs until the loops have settled, and measure the error after that."""
    run = content["run"]
    if run["settling"]:  # the tasks with a time after the motion
        accepted = [one for one in found.values() if not one.refusal]
        decay = min((-one.margins["growth"] for one in accepted), default=np.inf)
        least = run["settling"] * _AFTER
        longest = _STICKING_PERIODS * least / _AFTER
        sticking = max((min(one.sticking_time, longest) for one in accepted), default=0.0)
        time = float(f"{max(_TIME_CONSTANTS / decay, sticking):.2g}")
        end, after = run["duration"] - least, max(least, time)
        content["run"] = run | {
            "duration": rounded([end + after], 6)[0],
            "settling": float(f"{after * (1.0 - 1.0 / _AFTER):.2g}"),
        }
