"""Derivatives of a run with respect to parameters: ``flexarm.sensitivities``.

The function g of an event is zero at its time, whatever the parameter is. With the derivatives of
the state at a constant time, that of the event's time follows from dg = 0; theory page
"separation", section 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Unpack

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import AccuracyWarning, InputError, Problem, public_call, warn_caller
from flexarm.base.late import xr
from flexarm.base.processes import usable_cores
from flexarm.control.design.arm_scales import size_of_zero
from flexarm.integrate.base import FloatArray
from flexarm.integrate.torque import slope_at
from flexarm.kernels.compilation.duals import DIRECTIONS, DualArray
from flexarm.linear.vibration.modal import lowest_frequency
from flexarm.model.paths import number_at, with_number
from flexarm.model.quantities import Flag
from flexarm.simulation.calls.preparation import DrivenArguments, Situation, situation_of
from flexarm.simulation.calls.result import coordinates_of
from flexarm.simulation.derivatives.differences import differences, local_slopes
from flexarm.simulation.derivatives.dual_run import channel_derivatives, run_in_duals
from flexarm.simulation.derivatives.loop_in_duals import loop_in_duals
from flexarm.simulation.derivatives.parameters import (
    SAMPLE,
    Parameters,
    check_channels,
    differentiated,
    is_of_arm,
    refuse_unsupported,
    simulated,
    state_errors,
)
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.events import Event, Found, function_for
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings, with_keywords
from flexarm.simulation.run.stepping import Run

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
    """An event of a run, with the derivatives of its function there."""

    time: float  # s
    slopes: FloatArray  # (2, dof) of the function by q and qd
    rate: float  # of the function, 1/s
    motion: FloatArray  # (2, dof) qd and qdd
    partial: FloatArray  # (parameters,) at a constant state

    def time_slopes(self, states: FloatArray, first: int) -> FloatArray:
        """Return the derivatives (k,) of the time from those (k, 2, dof) of the state there."""
        own = self.partial[first : first + len(states)]
        return np.asarray(-(np.tensordot(states, self.slopes, 2) + own) / self.rate)


def crossings(known: Parameters, paths: Sequence[str]) -> list[Crossing]:
    """Return the events of a run."""
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
    """Return the derivatives of the events' times (events,), q and qd (events, dof)."""
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
    # Without vibrations the motion at the event has the only scale of time.
    fastest = max(np.abs(motion[0] / size).max(), np.abs(motion[1] / size).max() ** 0.5)
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
    return np.asarray(stages[0])


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


@public_call
@with_keywords(DrivenArguments, Situation)
def sensitivities(
    arm: Arm,
    duration: float,
    parameters: Sequence[str],
    *,
    channels: Sequence[str] | None = None,
    error_estimate: Flag = True,
    settings: RunSettings | None = None,
    **arguments: Unpack[DrivenArguments],
) -> xr.Dataset:
    """Compute the derivatives of a run with respect to parameters.

    They are the derivatives of the steps of the integrator, exact to rounding at constant lengths.
    They differ from those of the motion by the error of the steps.

    Args:
        arm: the arm.
        duration: s, positive.
        parameters: paths of numbers of the arm, ``links[0].flexural_rigidity``,
            ``joints[1].friction.coulomb``, ``payload.mass``; entries of the initial state,
            ``initial[0]`` (of q) and ``initial_rate[0]`` (of qd); and numbers of other arguments:
            ``torque[12][0]`` (sample, joint; both from 0), ``tip_force[1]``,
            ``loads[0].force[0]``, ``contacts[0].stiffness``.
        channels: names of channels that follow from q and qd; None: all of them.
        error_estimate: whether a run that meets a contact or a joint stop, or slides against
            friction that holds, is repeated at a second tolerance, a hundredth of the first one
            (with friction a ten-thousandth) or, near rounding, a hundred times it (fixed steps:
            half the step). The derivatives
            are then those of the more accurate run, and their largest difference is the coordinate
            ``relative_error``.

    The other arguments are those of ``simulate``; ``arm`` is the simulated arm, and a controller
    has its own model. The function of an event of your own is one of t, q and qd alone: if it uses
    an arm, that arm does not change. The updates of a controller are differentiated with respect to
    its readings and its memory, so it must have a ``step``. Changes of the arm and section forces
    are not supported.

    Returns:
        Dataset with the derivatives of the channels over ``parameter`` and ``time``, in the unit of
        the channel per unit of the parameter. The coordinate ``relative_error`` over ``parameter``
        exists if the error was estimated.

    Raises:
        InputError: if an argument has the wrong type or value or is not supported, or a parameter
            does not exist or is not one on which the equations depend smoothly, or a controller is
            not differentiable, reads rounded signals or has no ``step``.
        SimulationError: if the run stops early, or a function of time raises an exception.

    Warns:
        AccuracyWarning: under the conditions of ``simulate``, or if the estimated error exceeds
            1e-2 (with a given step: 1e-3).

    Theory page "separation", section 7.
    """
    refuse_unsupported(sensitivities, arguments)
    situation = situation_of(sensitivities, arm, duration, settings, arguments)
    paths = check_list_of("parameters", parameters, str)
    names = check_channels(arm, "channels", channels)
    if not paths:
        raise InputError(Problem("parameters", "must not be empty"))
    with Meter("differentiating", situation.settings.progress) as meter:

        def once(run: Situation, exactly: bool) -> _Derivatives:
            by_samples = any(SAMPLE.fullmatch(path) for path in paths)
            known = simulated(run, by_samples, meter, once=exactly)
            return _derivatives(known, paths, names)

        def apart(one: _Derivatives, other: _Derivatives) -> FloatArray:
            return state_errors(one.run, one.states, other.run.sample_times, other.states)

        found, errors, doubt = differentiated(situation, error_estimate, once, apart)
    if doubt:
        warn_caller(doubt, AccuracyWarning)
    return _dataset(found, paths, errors)


class _Derivatives(NamedTuple):
    """Derivatives of a run by each parameter."""

    run: Run
    channels: list[dict[str, FloatArray]]
    states: FloatArray  # (parameters, samples, 2, n, 1 + m)


def _derivatives(known: Parameters, paths: Sequence[str], names: Sequence[str]) -> _Derivatives:
    """Return the derivatives of the channels by each parameter."""
    by = known.derivatives(paths)
    run, arm = known.run, known.run.arm
    events = crossings(known, paths)
    blocks = [by[first : first + DIRECTIONS] for first in range(0, len(by), DIRECTIONS)]
    found: list[dict[str, FloatArray]] = []
    states: list[FloatArray] = []
    if known.loop is not None:  # Python for most of its time, which threads would only interrupt
        runs = loop_in_duals(run, known.inputs, blocks, known.loop)
    else:
        with ThreadPoolExecutor(min(len(blocks), usable_cores())) as pool:
            runs = list(pool.map(partial(run_in_duals, run, known.inputs), blocks))
    for block, one in zip(blocks, runs, strict=True):
        first, count = len(found), len(block)
        if run.watch is not None and run.watch.log.ended_by is not None:
            moved_to(one.samples, arm, events[-1], first, count)
        channels = channel_derivatives(arm, one, count, names)
        if run.watch is not None:
            at_events = arm.unpadded(one.events.slopes[:count])
            both = zip(channels, event_slopes(events, at_events, first), strict=True)
            channels = [{**channel, **event} for channel, event in both]
        found += channels
        states += list(one.samples.slopes[:count])
    return _Derivatives(run, found, np.array(states))


def _dataset(
    derivatives: _Derivatives, paths: Sequence[str], errors: FloatArray | None
) -> xr.Dataset:
    run, found = derivatives.run, derivatives.channels
    variables = {}
    for name in found[0]:
        unit, meaning, axes = _label(name)
        labels = {
            "units": f"{unit} per unit of the parameter",
            "long_name": f"derivative of: {meaning}",
        }
        variables[name] = (("parameter", *axes), np.stack([one[name] for one in found]), labels)
    labels = {"long_name": "path of the parameter"}
    coordinates = coordinates_of(run.arm, run.sample_times)
    coordinates["parameter"] = "parameter", list(paths), labels
    if run.watch is not None:
        log = run.watch.log
        events = [log.names[one.place] for one in log.found]
        coordinates["event_name"] = ("event", events, {"long_name": "name of the event"})
    dims = [variable[0] for variable in variables.values()]
    used = {"parameter", "time", "event_name"}.union(*dims)
    coordinates = {name: value for name, value in coordinates.items() if name in used}
    if errors is not None:
        labels = {"units": "1", "long_name": "estimated relative error of the derivatives"}
        coordinates["relative_error"] = ("parameter", errors, labels)
    attributes = {"integrator": run.integrator.name, "steps": run.progress.steps}
    return xr.Dataset(variables, coords=coordinates, attrs=attributes)


def _label(name: str) -> tuple[str, str, tuple[str, ...]]:
    """Return unit, meaning and axes of a channel, or of a variable of the events."""
    if name in EVENTS:
        return EVENTS[name]
    channel = CHANNELS[name]
    return channel.unit, channel.meaning, ("time", *channel.dims)
