"""Gradient of a scalar goal by torque samples and initial state: ``flexarm.goal_gradient``.

The run is divided at the torque samples. Dual numbers give the derivatives of the state at each end
by the state and the torque of the interval, whose number does not depend on that of the samples. A
recursion backwards in time then collects the gradient; theory page "separation", (D.17).

The recursion repeats the run from checkpoint to checkpoint, the last part first, so that the
derivatives of a few parts are in memory at a time. Both the number of parts and the length of each
grow with the square root of the number of samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from functools import partial
from typing import NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.closed import by_independent
from flexarm.arm.observe import channels_of
from flexarm.base.arguments import check_mapping
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import xr
from flexarm.base.processes import usable_cores
from flexarm.integrate.base import FloatArray, Status
from flexarm.integrate.explicit_runge_kutta.runge_kutta import ExplicitRungeKutta
from flexarm.integrate.implicit.additive_tableau import Additive
from flexarm.integrate.memory import SOFTENED, TIME, new_memory
from flexarm.integrate.transfers import additive_transfers, explicit_transfers
from flexarm.kernels.compilation.cache import Entry
from flexarm.kernels.compilation.duals import DIRECTIONS, DualArray, Duals
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.model.quantities import Flag
from flexarm.simulation.calls.preparation import GoalArguments, Situation, situation_of
from flexarm.simulation.calls.result import coordinates_of
from flexarm.simulation.derivatives.dual_run import (
    DualRun,
    channel_derivatives,
    dual_inputs,
    dual_system,
    no_change,
)
from flexarm.simulation.derivatives.parameters import (
    Parameters,
    check_channels,
    differentiated,
    refuse_unsupported,
    relative_error,
    simulated,
)
from flexarm.simulation.histories.piecewise import Samples
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings, with_keywords
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.work import Checkpoints

#: Steps in one call of a stepper.
_STEPS = 4096
#: Powers of time in the torque between two samples.
_POWERS = {"hold": 1, "linear": 2, "cubic": 4}
#: Samples whose channels are differentiated together, which bounds the memory of long runs.
_CHUNK = 1024


#: Derivatives of a goal by channels, see `goal_gradient`.
Weights = Mapping[str, FloatArray]


class Block(NamedTuple):
    """Unit changes in eight directions, or fewer and zeros."""

    state: DualArray  # (2, n, 1 + m)
    torque: FloatArray  # (4, n, directions) coefficients of every piece


class Part(NamedTuple):
    """Intervals of a run between two checkpoints."""

    intervals: slice
    ends: FloatArray  # (intervals,) s
    breaks: FloatArray  # (pieces,) s, starts of the pieces of the torque
    coefficients: FloatArray  # (pieces, 4, n) of the torque
    state: FloatArray  # (2, n, 1 + m) at the start
    clock: FloatArray  # ``Memory.clock`` at the start


def blocks_of(arm: Arm, powers: int) -> list[Block]:
    """Return unit changes of the state, then of ``powers`` torque coefficients of each joint."""
    joints, count = arm.assembly.joint_body, 2 * arm.dof
    states = arm.padded(np.eye(count, count + powers * arm.n_joints).T.reshape(-1, 2, arm.dof))
    torques = np.zeros((len(states), 4, states.shape[2]))
    for power in range(powers):
        for joint, body in enumerate(joints):
            torques[count + power * arm.n_joints + joint, power, body] = 1.0
    found = []
    for k in range(0, len(states), DIRECTIONS):
        own = slice(k, k + DIRECTIONS)
        state, torque = (Duals.of(part[0] * 0.0, part[own]) for part in (states, torques))
        found.append(Block(state, torque.array[..., 1:]))
    return found


def parts_of(known: Parameters, ends: FloatArray, pieces: Sequence[int]) -> list[Part]:
    """Divide intervals, given by their ``ends`` (s) and the ``pieces`` of the torque in them."""
    run, checkpoints = known.run, known.checkpoints
    assert run.history is not None
    assert checkpoints is not None
    places = [0, *checkpoints.places]
    times = run.sample_times[places]
    edges = [*np.searchsorted(ends, times, side="right"), len(ends)]
    step = run.integrator.step or (run.progress.step if run.default_step is not None else 0.0)
    step = step or run.integrator.first_step(run.tolerance.fastest)
    first = new_memory(known.inputs.state, step).clock
    found = []
    for k, place in enumerate(places):
        if edges[k] == edges[k + 1]:
            continue
        own = slice(pieces[edges[k]], pieces[edges[k + 1] - 1] + 1)
        clock = (checkpoints.clocks[k - 1] if k and checkpoints.clocks else first).copy()
        clock[TIME], clock[SOFTENED] = times[k], np.nan
        intervals = slice(edges[k], edges[k + 1])
        torque = run.history.breaks[own], known.inputs.torque[own]
        found.append(Part(intervals, ends[intervals], *torque, run.samples[place], clock))
    return found


class Repetition:
    """Repetition of parts of a run in dual numbers, with arrays that all parts share."""

    def __init__(self, known: Parameters, parts: Sequence[Part], blocks: Sequence[Block]) -> None:
        run = known.run
        assert run.history is not None
        self._run, self._blocks = run, blocks
        pieces = max(len(part.breaks) for part in parts)
        torque = np.zeros((pieces, *known.inputs.torque.shape[1:]))
        inputs = known.inputs._replace(torque=torque)
        numbers = dual_inputs(inputs, [no_change(inputs)])
        system = dual_system(run.system(run.history), numbers)
        self.system = system._replace(drive=system.drive._replace(breaks=np.zeros(pieces + 1)))
        self.gauges = numbers.arm.gauges
        self._torque: DualArray = numbers.torque
        self._memory = new_memory(numbers.state, 0.0)
        self._record = run.integrator.record(system.constants, numbers.state)
        most = max(len(part.ends) for part in parts)
        self._ends = np.zeros((len(blocks), most, *numbers.state.shape, 1 + DIRECTIONS))
        additive = isinstance(run.integrator, Additive)
        self._entry = Entry(additive_transfers if additive else explicit_transfers)

    def transfers(self, part: Part) -> FloatArray:
        """Return the derivatives (intervals, 2 dof, directions) of the states at the ends."""
        run, memory, count = self._run, self._memory, len(part.breaks)
        breaks, assembly = self.system.drive.breaks, run.arm.assembly
        breaks[:count], breaks[count:] = part.breaks, np.inf
        self._torque.value[:count] = part.coefficients
        states: DualArray = memory.state
        for block, ends in zip(self._blocks, self._ends[:, : len(part.ends)], strict=True):
            self._torque.array[..., 1:] = block.torque
            states.value[...] = part.state
            memory.clock[:] = part.clock
            status = self._entry(
                self.system, run.tolerance, self._record, memory, part.ends, block.state,
                Duals(ends), _STEPS,
            )  # fmt: skip
            if status != Status.DONE.value:
                raise run.failure(Status(status))
        whole = self._ends.reshape(*self._ends.shape[:3], -1, 1 + DIRECTIONS)
        slopes = whole[:, : len(part.ends), :, assembly.coordinates, 1:]
        columns = len(self._blocks) * DIRECTIONS
        return np.asarray(np.moveaxis(slopes, 0, 3).reshape(len(part.ends), -1, columns))

    def by_samples(self, weights: Weights, pool: Executor) -> FloatArray:
        """Return the gradient (samples, 2 dof) of the goal by the states at the samples."""
        states, count = self._run.samples, 2 * self._run.arm.dof
        sizes = [min(DIRECTIONS, count - first) for first in range(0, count, DIRECTIONS)]
        gradients = []
        for first in range(0, len(states), _CHUNK):
            block = slice(first, first + _CHUNK)
            weights_of_block = {name: array[block] for name, array in weights.items()}
            of_block = partial(self._of_block, weights_of_block, states[block])
            gradients.append(np.concatenate(list(pool.map(of_block, self._blocks, sizes))).T)
        return np.concatenate(gradients)

    def _of_block(
        self, weights: Weights, states: FloatArray, block: Block, count: int
    ) -> FloatArray:
        """Return the derivatives (count, samples) of the goal by ``states`` in some directions."""
        duals = Duals.of(states)
        duals.array[..., 1:] = block.state.array[..., 1:]
        run = DualRun(duals, self.system.constants, self.gauges, 0)
        slopes = channel_derivatives(self._run.arm, run, count, list(weights))
        parts = [[(w * one[n]).reshape(len(w), -1) for n, w in weights.items()] for one in slopes]
        return np.array([sum(part.sum(axis=1) for part in own) for own in parts])


class Gradient(NamedTuple):
    """Gradient of a goal."""

    run: Run
    torque: FloatArray  # (samples, joints)
    state: FloatArray  # (2, dof) by q and qd at the start


def goal_gradient_of(known: Parameters, samples: Samples, weights: Weights) -> Gradient:
    """Return the gradient of the sum of ``weights`` times channels over all samples of a run."""
    run, arm = known.run, known.run.arm
    if not isinstance(run.integrator, ExplicitRungeKutta | Additive):
        rule = "be an explicit Runge-Kutta method or kennedy_carpenter_5 for a gradient"
        raise InputError(Problem("integrator", rule, shown(run.integrator.name)))
    assert run.history is not None
    breaks = run.history.breaks
    ends = np.unique(np.concatenate([breaks, run.sample_times[1:], [run.duration]]))
    ends = ends[(ends > 0.0) & (ends <= run.duration)]
    middle = 0.5 * (np.append(0.0, ends[:-1]) + ends)
    piece = np.clip(np.searchsorted(breaks, middle, side="right") - 1, 0, len(breaks) - 2)
    parts = parts_of(known, ends, piece)
    powers = _POWERS[samples.interpolation]
    blocks = blocks_of(arm, powers)
    threads = min(usable_cores(), len(parts))
    repetitions = [Repetition(known, parts, blocks) for _ in range(threads)]
    torque = np.zeros((len(ends), powers * arm.n_joints))
    with ThreadPoolExecutor(threads) as pool:
        goal = repetitions[0].by_samples(weights, pool)
        at_ends = np.zeros((len(ends), goal.shape[1]))
        at_ends[np.searchsorted(ends, run.sample_times[1:])] = goal[1:]
        count, width, adjoint = goal.shape[1], torque.shape[1], np.zeros(goal.shape[1])
        for part, transfers in _from_the_last(parts, repetitions, pool):
            after, own = at_ends[part.intervals], torque[part.intervals]
            for k in reversed(range(len(transfers))):
                both = (adjoint + after[k]) @ transfers[k]
                adjoint, own[k] = both[:count], both[count : count + width]
    state = goal[0] + adjoint
    pieces = np.zeros((len(breaks) - 1, torque.shape[1]))
    np.add.at(pieces, piece, torque)
    by_samples = samples.collected(pieces.reshape(len(pieces), -1, arm.n_joints))
    start = arm.unpadded(run.samples[0])
    return Gradient(run, by_samples, by_independent(arm, start, state.reshape(2, -1)))


def _from_the_last(
    parts: Sequence[Part], repetitions: Sequence[Repetition], pool: Executor
) -> Iterator[tuple[Part, FloatArray]]:
    """Yield each part and its transfers, while those of the parts before it are computed."""
    together = len(repetitions)
    found: list[tuple[Part, FloatArray]] = []
    for last in range(len(parts), 0, -together):
        group = parts[max(0, last - together) : last][::-1]
        ahead = pool.map(Repetition.transfers, repetitions, group)
        yield from found
        found = list(zip(group, ahead, strict=True))
    yield from found


@public_call
@with_keywords(GoalArguments, Situation)
def goal_gradient(
    arm: Arm,
    duration: float,
    weights: Mapping[str, ArrayLike],
    *,
    torque: ArrayLike,
    error_estimate: Flag = True,
    settings: RunSettings | None = None,
    **arguments: Unpack[GoalArguments],
) -> xr.Dataset:
    """Compute the gradient of a goal with respect to all torque samples and the initial state.

    Its cost does not depend on the number of samples. The steps end at every torque sample and are
    constant, as in ``sensitivities``.

    Args:
        arm: the arm.
        duration: s, positive.
        weights: for each channel in the goal, the derivatives of the goal by its samples, with the
            shape of the channel in the result of ``simulate``. Channels that follow from q and qd
            are possible.
        torque: samples (samples, joints), N m.
        error_estimate: whether a run that meets a contact or a joint stop is repeated at a second
            tolerance, as in ``sensitivities``. The attribute ``relative_error`` is the largest
            difference of both gradients by ``torque``, relative to the largest entry.

    The other arguments are those of ``simulate``.

    Returns:
        Dataset with the gradient by ``torque`` over ``sample`` and ``joint``, per N m, and by
        ``initial`` and ``initial_rate`` over ``coordinate``; with closures by independent
        coordinates, which the others follow.

    Raises:
        InputError: if an argument has the wrong type or value, or the integrator is not an explicit
            Runge-Kutta method or ``kennedy_carpenter_5``.
        SimulationError: if the run stops early, or a function of time raises an exception.

    Warns:
        AccuracyWarning: under the conditions of ``simulate``, or if the estimated error exceeds
            1e-2 (with a given step: 1e-3).

    Theory pages "separation", (D.17), and "mechanisms", (M.29).
    """
    refuse_unsupported(goal_gradient, arguments)
    driven = {**arguments, "torque": check_array("torque", torque, (-1, arm.n_joints))}
    situation = situation_of(goal_gradient, arm, duration, settings, driven)
    refuse_bristles(arm, "the gradient", hint="fa.sensitivities supports them.")
    check_mapping("weights", weights, "channels and arrays")
    names = check_channels(arm, "weights", list(weights))
    if not names:
        raise InputError(Problem("weights", "must not be empty"))
    with Meter("differentiating", situation.settings.progress) as meter:

        def once(again: Situation, exactly: bool) -> Gradient:
            checkpoints = Checkpoints.among(len(situation.times))
            known = simulated(again, True, meter, checkpoints, once=exactly)
            channels = channels_of(arm, known.run.samples, names)
            arrays = {
                name: check_array(f"weights[{name!r}]", weights[name], channels[name].shape)
                for name in names
            }
            assert known.samples is not None
            return goal_gradient_of(known, known.samples, arrays)

        def apart(one: Gradient, other: Gradient) -> FloatArray:
            return np.array([relative_error(one.torque, other.torque)])

        found, errors, doubt = differentiated(situation, error_estimate, once, apart)
    run, attributes = found.run, {} if errors is None else {"relative_error": float(errors[0])}
    if doubt:
        warn_caller(doubt, AccuracyWarning)
    own = coordinates_of(arm, run.sample_times)
    q, qd = (("coordinate", row) for row in found.state)
    variables = {"torque": (("sample", "joint"), found.torque), "initial": q, "initial_rate": qd}
    coordinates = {name: own[name] for name in ("joint", "coordinate")}
    method = {"integrator": run.integrator.name, "steps": run.progress.steps}
    return xr.Dataset(variables, coordinates, {**method, **attributes})
