"""Rows of ``flexarm check``: frequencies, sample time, integrator, and the sampled loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.cases.scenario.scenario import Prepared
from flexarm.control.analysis.sample_time import PHASE, controlled_modes, recommended_sample_time
from flexarm.integrate.base import FloatArray
from flexarm.linear import modes
from flexarm.simulation.calls.preparation import integrator_of
from flexarm.simulation.loop.stability import LoopPole

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


def about_integrator(arm: Arm, options: Mapping[str, Any] | None = None) -> Rows:
    """Return the integrator of a run with these arguments of ``simulate``, and the reason.

    Without arguments, it is that of an arm which moves freely for one second.
    """
    arguments = dict(options or {"duration": 1.0})
    requested, step = arguments.get("integrator", "auto"), arguments.get("step")
    recommended = integrator_of(arm, **{**arguments, "integrator": "auto", "step": None})
    text = f"{recommended.integrator.name} is recommended: {recommended.reason}"
    if requested == "auto" and step is None:
        return [("integrator", text)]
    used = integrator_of(arm, **arguments)
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
