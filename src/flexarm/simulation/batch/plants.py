"""Many plants of one arm that are stepped together, in lanes and threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions.environment import EMPTY
from flexarm.arm.arm import Arm
from flexarm.base.errors import SimulationError
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneDrive, LaneRuns
from flexarm.integrate.lanes.stepper import LaneIntegrator, LaneStepper, lane_method
from flexarm.integrate.memory import CLOCK_PLACES, COUNT_PLACES, STEP, TIME
from flexarm.kernels.compilation.packs import LANES
from flexarm.simulation.batch.lanes import arms_of_runs, factors_of
from flexarm.simulation.histories.loads import LoadHistory, load_history
from flexarm.simulation.run.integrator_choice import choose_integrator
from flexarm.simulation.run.new_run import UNBOUNDED
from flexarm.simulation.run.settings import DEFAULTS, request_of, tolerances_of
from flexarm.simulation.run.stepping import failure_of
from flexarm.simulation.run.tolerance import (
    fastest_frequencies,
    tip_units,
)
from flexarm.simulation.run.work import choose_by_samples

#: Attempted steps of one sample time, after which a plant fails.
_MOST_STEPS = 200_000
#: Plants that a thread advances in one call: enough to hide the cost of the call, and few enough
#: that a thread which has finished early takes another block.
_BLOCK = 256

Places = NDArray[np.intp]


class _Block(NamedTuple):
    """Plants that a thread advances in one call."""

    method: LaneIntegrator
    rows: Places  # in the arguments of ``step``
    places: Places  # of the plants


class LanePlants:
    """Plants of one arm, with its exact state and with motors that apply the torque exactly.

    Each plant has the numbers of a ``flexarm.Plant`` with the same arguments, to the last bit, for
    any number of plants and threads.

    Args:
        arm: the simulated arm, one that `arm_fits_lanes` accepts.
        count: number of plants.
        sample_time: s from one step to the next.
        threads: that advance the plants.

    Attributes:
        state: (count, 2, n, 1 + m) of the plants at their current times.
        tick: (count,) number of completed steps of each since its start.
    """

    def __init__(self, arm: Arm, count: int, sample_time: float, threads: int) -> None:
        self.arm, self._sample_time = arm, sample_time
        n, m = arm.assembly.bodies, arm.assembly.modes
        self.state = np.zeros((count, 2, n, 1 + m))
        self.tick = np.zeros(count, dtype=np.int64)
        self._clock = np.zeros((count, CLOCK_PLACES))
        self._fastest = np.ones(count)
        self._methods: list[LaneIntegrator] = []
        self._method = np.zeros(count, dtype=np.int64)  # index in ``_methods``
        self._horizon = UNBOUNDED * sample_time
        relative, absolute, scale = tolerances_of(DEFAULTS, arm)  # those of a `Plant`
        self._by_accuracy = request_of(DEFAULTS, arm) is not None
        unit = tip_units(arm, scale, self._horizon)
        self._tolerance = Tolerance(absolute, relative, unit, 1.0 / self._horizon, scale)
        self._loads = load_history(arm, EMPTY, sample_time, relative)
        placed = self._loads.placed
        self._stepper = LaneStepper(arm.assembly.constants, placed, self._tolerance, several=False)
        self._constants = arms_of_runs([arm], [placed], None, self._horizon)
        self._threads = threads
        self._pool = ThreadPoolExecutor(threads, "flexarm") if threads > 1 else None

    @property
    def time(self) -> FloatArray:
        """Time (count,) of each plant since its start, s."""
        return self._clock[:, TIME]

    def start(self, places: Places, q: FloatArray) -> None:
        """Begin anew at rest at the coordinates q (k, dof) of the plants ``places`` (k,)."""
        states = self.arm.padded(np.stack([q, np.zeros_like(q)], axis=1))
        fastest = fastest_frequencies(self.arm, states, 1.0 / self._horizon)
        self.state[places], self._fastest[places] = states, fastest
        self._clock[places] = 0.0
        self.tick[places] = 0
        for place, frequency in zip(places.tolist(), fastest.tolist(), strict=True):
            tolerance = self._tolerance._replace(fastest=frequency)
            choice = choose_integrator("auto", None, self.arm, tolerance)
            choice = choose_by_samples(
                choice, self.arm, self._sample_time, by_accuracy=self._by_accuracy
            )
            method = lane_method(choice.integrator)
            assert method is not None  # "auto" has step control
            if method not in self._methods:
                self._methods.append(method)
            self._method[place] = self._methods.index(method)
            self._clock[place, STEP] = method.first_step(frequency)

    def step(self, places: Places, torque: FloatArray) -> dict[int, SimulationError]:
        """Apply torques (k, joints), N m, to the plants ``places`` (k,) for one sample time.

        Returns:
            The failures by the number of the plant. The plant keeps its last valid state and its
            time, and its ``tick`` does not change; start it before the next step.
        """
        padded = self.arm.padded_torque(torque)
        blocks = [
            block
            for k, method in enumerate(self._methods)
            for block in self._blocks(method, np.flatnonzero(self._method[places] == k), places)
        ]
        if self._pool is None or len(blocks) == 1:
            done = [self._advance(block, padded) for block in blocks]
        else:
            done = list(self._pool.map(self._advance, blocks, [padded] * len(blocks)))
        failed = {}
        for block, status in zip(blocks, done, strict=True):
            self.tick[block.places] += status == Status.DONE
            for row in np.flatnonzero(status != Status.DONE):
                place = int(block.places[row])
                failed[place] = self._failure(place, Status(status[row]))
        return failed

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()

    def _blocks(self, method: LaneIntegrator, rows: Places, places: Places) -> list[_Block]:
        """Divide plants of one method into blocks of whole packs, at least one for each thread."""
        share = -(-len(rows) // self._threads)
        size = min(_BLOCK, -(-share // LANES) * LANES)
        parts = [rows[k : k + size] for k in range(0, len(rows), max(size, 1))]
        return [_Block(method, part, places[part]) for part in parts]

    def _advance(self, block: _Block, torque: FloatArray) -> NDArray[np.int64]:
        """Advance the plants of a block by one sample time; return their statuses."""
        places, count = block.places, len(block.places)
        now = self.tick[places]
        runs = LaneRuns(
            *self._constants,
            state=self.state[places],
            fastest=self._fastest[places],
            clock=self._clock[places],
            counts=np.zeros((count, COUNT_PLACES), dtype=np.int64),
            status=np.full(count, Status.PAUSED.value),
            sample_times=np.zeros(0),
            samples=np.zeros((count, 0, *self.state.shape[1:])),
            until=(now + 1) * self._sample_time,
        )
        runs.clock[:, TIME] = now * self._sample_time
        drive = _held(torque[block.rows], self._loads)
        self._stepper.advance(block.method, drive, runs, _MOST_STEPS)
        self.state[places], self._clock[places] = runs.state, runs.clock
        return runs.status

    def _failure(self, place: int, status: Status) -> SimulationError:
        state = self.arm.unpadded(self.state[place])
        reason = ""
        if status == Status.PAUSED:
            reason = f"a sample time takes more than {_MOST_STEPS} steps: the motion is unstable."
        return failure_of(status, float(self.time[place]), (state[0], state[1]), reason)


def _held(torque: FloatArray, loads: LoadHistory) -> LaneDrive:
    """Return the drive of runs with constant torques (k, n)."""
    count, n = torque.shape
    coefficients = np.zeros((count, 4, n))
    coefficients[:, 0] = torque
    places = np.zeros((count, 6), dtype=np.int64)
    places[:, 1] = 2
    places[:, 2] = np.arange(count)
    places[:, 3] = places[:, 2] + 1
    breaks, stops = np.array([0.0, 1.0]), np.zeros(0)
    return LaneDrive(breaks, coefficients, stops, places, **factors_of(loads))
