"""Rows of ``flexarm check``: frequencies, sample time, integrator, and the sampled loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from flexarm.arm import Arm
from flexarm.engine.contact_setup import contact_frequency, contacts_of_run
from flexarm.engine.integrator_choice import choose_by_drive, choose_integrator
from flexarm.engine.tolerance import RTOL, tolerance_of
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes
from flexarm.loop.stability import LoopPole
from flexarm.loop_analysis.sample_time import PHASE, controlled_modes, recommended_sample_time
from flexarm.scenarios.scenario import Prepared

Rows = list[tuple[str, str]]

_MOST_FREQUENCIES = 4


def about_prepared(prepared: Prepared, poles: Sequence[LoopPole]) -> Rows:
    """Return the rows of a scenario."""
    arm, options = prepared.arm, prepared.options
    angles = arm.joint_angles(options["initial"])
    rows = about_vibration(arm, angles, prepared.sample_time)
    rows += about_integrator(arm, options)
    if prepared.sample_time is not None:
        rows.append(("loop", _stability(poles)))
    return rows


def about_vibration(
    arm: Arm, angles: FloatArray | None = None, sample_time: float | None = None
) -> Rows:
    """Return the lowest frequencies with locked joints, and the sample time that suits them.

    Args:
        angles: posture (joints,), rad; zero by default.
        sample_time: of the controller, s.
    """
    found = modes(arm, angles).frequency_hz
    found = found[found > 0.0]
    if not found.size:
        return []
    where = "at joint angles of zero" if angles is None else "at the start"
    listed = ", ".join(f"{frequency:.4g}" for frequency in found[:_MOST_FREQUENCIES])
    rows = [("frequencies", f"{listed} Hz with the joints locked, {where}")]
    longest = recommended_sample_time(arm, angles)
    if longest is not None:
        text = f"{1e3 * longest:g} ms or less for a controller: {2.0 * np.pi / PHASE:.0f} samples "
        text += f"in a period of mode {controlled_modes(arm, found)}"
        if sample_time is not None:
            text += f"; this one has {1e3 * sample_time:g} ms"
        rows.append(("sample time", text))
    return rows


def about_integrator(arm: Arm, options: dict[str, Any] | None = None) -> Rows:
    """Return the integrator of a run with these arguments of ``simulate``, and the reason."""
    given = options or {}
    q = np.asarray(given.get("initial", np.zeros(arm.dof)))
    state = arm.padded(np.stack([q, np.zeros(arm.dof)]))
    accuracy = given.get("atol"), given.get("rtol", RTOL)
    tolerance = tolerance_of(arm, state, *accuracy, given.get("duration", math.inf))
    touch = contact_frequency(arm, contacts_of_run(arm, given.get("contacts", ()), state))
    prescribed = tuple(given.get("prescribed") or ())
    choice = choose_integrator("auto", None, arm, tolerance, touch, prescribed)
    text = f"{choice.integrator.name} is recommended: {choice.reason}"
    requested, step = given.get("integrator", "auto"), given.get("step")
    if requested == "auto" and step is None:
        return [("integrator", text)]
    used = choose_integrator(requested, step, arm, tolerance, touch)
    if "controller" not in given:
        stops = getattr(given.get("torque"), "stops", np.zeros(0))
        used = choose_by_drive(used, arm, tolerance, stops, given["duration"])
    reason = f" ({used.reason})" if requested == "auto" else ""
    return [("integrator", f"{used.integrator.name}{reason}; {text}")]


def _stability(poles: Sequence[LoopPole]) -> str:
    """Describe the sampled loop at the start and at the end of a motion."""
    if not poles:
        return "not analysed: the controller or an instrument does not permit it"
    return "; ".join(_pole(pole) for pole in poles)


def _pole(pole: LoopPole) -> str:
    grows = pole.growth > 0.0
    time = np.log(10.0) / max(abs(pole.growth), 1e-12)
    changes = f"the {'fastest' if grows else 'slowest'} pole, at {pole.frequency:.3g} Hz,"
    changes += f" {'grows' if grows else 'decays'} tenfold in {time:.2g} s"
    return f"{'unstable' if grows else 'stable'} {pole.when}: {changes}"
