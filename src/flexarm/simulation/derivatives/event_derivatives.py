"""Derivatives of the times of events and of the states there.

The function g of an event is zero at its time, whatever the parameter is. With the derivatives of
the state at a constant time, that of the event's time follows from dg = 0; theory page
"separation", section 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.errors import InputError, Problem
from flexarm.control.design.arm_scales import size_of_zero
from flexarm.integrate.base import FloatArray
from flexarm.integrate.torque import slope_at
from flexarm.kernels.compilation.duals import DualArray
from flexarm.linear.vibration.lowest import lowest_frequency
from flexarm.model.paths import number_at, with_number
from flexarm.simulation.derivatives.differences import differences, local_slopes
from flexarm.simulation.derivatives.parameters import Parameters, is_of_arm
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.events import Event, Found, function_for

#: Unit, meaning and axes of the variables of the events.
EVENTS = {
    "event_time": ("s", "time of the event", ("event",)),
    "event_q": ("rad or m kg^0.5", "coordinates at the event", ("event", "coordinate")),
    "event_qd": ("rad/s or m kg^0.5/s", "their rates at the event", ("event", "coordinate")),
}
#: Step of the differences of an event's function, relative to the sizes of q, qd and t.
_STEP = 0.01
#: Change of the function over this time, relative to its values at these steps, that is none.
_TANGENT = 1e-8
#: Distance (s, relative) to the left of an event at which a sampled torque is taken.
_BEFORE = 1e-9


@dataclass(frozen=True)
class Crossing:
    """An event of a run, with the derivatives of its function there.

    Attributes:
        time: s. slopes: (2, dof) of the function by q and qd. rate: of the function, 1/s.
        motion: (2, dof) qd and qdd. partial: (parameters,) at a constant state.
    """

    time: float
    slopes: FloatArray
    rate: float
    motion: FloatArray
    partial: FloatArray

    def time_slopes(self, states: FloatArray, first: int) -> FloatArray:
        """Return the derivatives (k,) of the time, from those (k, 2, dof) of the state there.

        Args:
            first: place of the first of the k parameters.
        """
        own = self.partial[first : first + len(states)]
        found: FloatArray = -(np.tensordot(states, self.slopes, 2) + own) / self.rate
        return found


def crossings(known: Parameters, paths: Sequence[str]) -> list[Crossing]:
    """Return the events of a run.

    Raises:
        InputError: if the function of an event is not differentiable there, or not by a parameter.
    """
    run = known.run
    log = run.watch.log if run.watch is not None else None
    if log is None:
        return []
    events = ((log.events[one.place], log.names[one.place], one) for one in log.found)
    return [_crossing(known, paths, *one) for one in events]


def moved_to(states: DualArray, arm: Arm, crossing: Crossing, first: int, count: int) -> None:
    """Let the last of the states (k, 2, n, 1 + m) follow the time of the event that ends a run."""
    slopes = arm.unpadded(states.slopes[:count, -1])
    moved = slopes + np.multiply.outer(crossing.time_slopes(slopes, first), crossing.motion)
    states.array[-1, ..., 1 : 1 + count] = np.moveaxis(arm.padded(moved), 0, -1)


def event_slopes(
    events: Sequence[Crossing], states: FloatArray, first: int
) -> list[dict[str, FloatArray]]:
    """Return the derivatives of the events' times (events,), q and qd (events, dof).

    Args:
        states: (k, events, 2, dof), derivatives of the states at constant times.
    """
    times = [one.time_slopes(states[:, k], first) for k, one in enumerate(events)]
    time = np.reshape(times, (len(events), len(states))).T
    motion = np.reshape([one.motion for one in events], (len(events), *states.shape[2:]))
    whole = states + time[:, :, None, None] * motion
    return [
        {"event_time": t, "event_q": x[:, 0], "event_qd": x[:, 1]}
        for t, x in zip(time, whole, strict=True)
    ]


def _crossing(
    known: Parameters, paths: Sequence[str], event: Event, name: str, found: Found
) -> Crossing:
    arm, dof = known.run.arm, known.run.arm.dof
    motion = arm.unpadded(_motion(known, found))
    point = np.concatenate([arm.unpadded(found.state).ravel(), [found.time]])

    def values(points: FloatArray) -> FloatArray:
        return _values(event.function, points, dof)

    size = coordinate_sizes(arm)
    # Without vibrations the rates at the event have the only scale of time.
    fastest = np.abs(point[dof:-1] / size).max()
    rate = lowest_frequency(arm)
    rate = rate if np.isfinite(rate) else fastest or 1.0
    steps = _STEP * np.concatenate([size, rate * size, [1.0 / rate]])
    slopes = local_slopes(values, point, steps)[:, 0]
    if not np.all(np.isfinite(slopes)):
        raise _refused(f"{name} at t = {found.time:.6g} s has a function that is not smooth")
    terms = slopes * np.append(motion, 1.0)
    change = float(terms.sum())
    nearby = np.abs(values(point + np.diag(steps))).max()
    if not abs(change) * steps[-1] > _TANGENT * nearby:
        raise _refused(f"{name} at t = {found.time:.6g} s touches zero without crossing it")
    partial = np.array([_partial(arm, event.function, path, point) for path in paths])
    return Crossing(found.time, slopes[:-1].reshape(2, dof), change, motion, partial)


def _refused(reason: str) -> InputError:
    return InputError(Problem("events", f"have no derivatives: {reason}"))


def _motion(known: Parameters, found: Found) -> FloatArray:
    """Return the rates and accelerations (2, n, 1 + m) just before an event."""
    run, history = known.run, known.run.history
    if known.loop is not None:
        now = known.loop.acting.at(np.array([found.time * (1.0 - _BEFORE)]))
        history = PiecewiseCubic.constant(now[0])
    assert history is not None
    system = run.system(history)
    kernels = KernelView(system.constants)
    stages, torque = kernels.zeros(1, 2), np.zeros(kernels.shape[0])
    slope_at(system, found.time, True, found.state, torque, stages, 0, True)
    motion: FloatArray = stages[0]
    return motion


def _values(function: Any, points: FloatArray, dof: int) -> FloatArray:
    """Return the values (p, 1) of an event's function at [q, qd, t], (p, 2 dof + 1)."""
    t, q, qd = points[:, -1], points[:, :dof], points[:, dof:-1]
    if getattr(function, "vectorized", False):
        return np.reshape(function(t, q, qd), (-1, 1))
    return np.array([[float(function(*one))] for one in zip(t.tolist(), q, qd, strict=True)])


def _partial(arm: Arm, function: Any, path: str, point: FloatArray) -> float:
    """Return the derivative of an event's function by a parameter, at a constant state.

    A built-in one depends on the arm, and one of the user on the time and the state alone.
    """
    if path.startswith("contacts[") and hasattr(function, "contact"):
        raise _refused(f"the gap of a contact event is not differentiated by {path}")
    if function_for(function, arm) is None or not is_of_arm(path):
        return 0.0

    def at(value: float) -> list[FloatArray]:
        # Unchecked, so that a mass of zero, which moves no point, may become negative.
        changed = Arm(with_number(arm.spec, path, value, checked=False))
        moved = function_for(function, changed)
        return [_values(moved, point[None], arm.dof)[0]]

    value = number_at("parameters", arm.spec, path)
    scale = abs(value) or size_of_zero(arm, arm.spec, path)
    return float(differences("parameters", path, value, scale, at)[0][0])
