"""Execution of runs with controllers in packs of eight, from one sample time to the next."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError, InputError
from flexarm.control.contract.base import Reference, report_of
from flexarm.control.hardware.instruments import stride_and_delay
from flexarm.integrate.base import FloatArray, Status, Tolerance
from flexarm.integrate.lanes.data import LaneRuns
from flexarm.simulation.batch.execution import ClosedLoop
from flexarm.simulation.batch.lane_loop import LaneLoop, LoopOfRun, can_read
from flexarm.simulation.batch.lanes import Advance, Lanes, Ready, fits_lanes
from flexarm.simulation.batch.variations import Variations
from flexarm.simulation.calls.compare import INCONSISTENT
from flexarm.simulation.calls.limits import instrument_warning, motor_warning
from flexarm.simulation.calls.preparation import Situation, start_of
from flexarm.simulation.loop.actuators import Acting
from flexarm.simulation.loop.requirements import misfits
from flexarm.simulation.loop.sampled_reference import sampled_reference
from flexarm.simulation.loop.stability import Poles, instability
from flexarm.simulation.run.integrator_choice import Choice, friction_doubt
from flexarm.simulation.run.work.estimate import choose_by_samples


def fits_closed_lanes(variations: Variations, shared: Situation, channels: Collection[str]) -> bool:
    """Return whether lanes support runs with controllers, as far as known before their start."""
    fits = fits_lanes(variations, shared, channels) and not shared.environment.contacts
    return fits and can_read(variations.hardware)


class ClosedLanes(Lanes):
    """Runs with controllers, eight at a time in each thread.

    Controllers are called by one thread at a time.
    """

    _alone: ClosedLoop

    def __init__(
        self,
        variations: Variations,
        shared: Situation,
        channels: Collection[str],
        alone: ClosedLoop,
    ) -> None:
        super().__init__(variations, shared, channels, alone)
        self._references: dict[tuple[int, float], Reference | None] = {}
        self._poles: dict[tuple[Any, ...], Poles] = {}

    def prepare(self) -> None:
        """Validate the first run.

        Raises:
            InputError: if ``simulate`` would raise it.
        """
        arm = self._variations.arm(0)
        try:
            self._run(0, arm, None)
        except FlexarmError:
            self._alone(0)

    def _run(self, k: int, arm: Arm, state: FloatArray | None) -> Ready:
        """Return run k before its start.

        Raises:
            InputError: if an argument does not fit the arm or the controller.
        """
        own, duration = self._variations, self._shared.duration
        controller, reference, hardware = own.controller(k), own.reference(k), own.hardware_of(k)
        assert controller is not None
        sample_time, loads = controller.sample_time, self._loads_on(arm)
        with self._alone.users:
            if state is None:
                state = start_of(arm, *own.state_of(k), reference, None)
            if problems := misfits(controller, arm, reference, hardware, 0):
                raise InputError(*problems)
            Acting(hardware, arm)
            for instrument in (hardware.instruments if hardware is not None else None) or ():
                stride_and_delay(instrument, sample_time)
            key = id(reference), sample_time
            if key not in self._references:
                self._references[key] = sampled_reference(reference, sample_time, duration)
            unstable = self._instability(k, arm, state)
        loop = LoopOfRun(controller, reference, self._references[key], hardware, unstable)
        return Ready(k, arm, state, loads, loop, (sample_time,))

    def _choice(self, run: Ready, tolerance: Tolerance) -> Choice:
        choice = super()._choice(run, tolerance)
        longest = float(run.drive.controller.sample_time)
        choice = choose_by_samples(choice, run.arm, longest, self._shared.duration)
        return choice._replace(doubt=friction_doubt(choice.integrator, run.arm, longest))

    def _instability(self, k: int, arm: Arm, state: FloatArray) -> str:
        """Return the warning of an unstable loop; equal loops are analysed once."""
        own = self._variations
        controller, reference = own.controller(k), own.reference(k)
        assert controller is not None
        # Arms with changed parameters are not kept, so that another one may have the same id.
        simulated = arm.spec if own.parameters else id(arm)
        known = self._poles.setdefault((simulated, id(controller), id(reference)), {})
        model, q = self._alone.model or arm, arm.unpadded(state[0])
        loop = controller, reference, own.hardware, ()
        return instability(model, arm, *loop, q, self._shared.duration, known)

    def _carry(self, advance: Advance, ready: Sequence[Ready], runs: LaneRuns) -> LaneLoop:
        loops = [run.drive for run in ready]
        duration, users = self._shared.duration, self._alone.users
        loads = ready[0].loads
        loop = LaneLoop([run.arm for run in ready], loops, duration, users, loads)
        loop.execute(advance, runs)
        runs.status[~loop.alive] = Status.PAUSED
        return loop

    def _torques(
        self, times: FloatArray, ready: Sequence[Ready], places: NDArray[np.intp], carried: LaneLoop
    ) -> dict[str, FloatArray]:
        return {
            "torque": carried.applied_at(times, places),
            "torque_command": carried.commanded_at(times, places),
        }

    def _limits(
        self,
        times: FloatArray,
        ready: Sequence[Ready],
        samples: FloatArray,
        places: NDArray[np.intp],
        carried: LaneLoop,
    ) -> tuple[dict[str, FloatArray], list[list[str]]]:
        numbers = {name: values[places] for name, values in carried.limits().items()}
        if not numbers:
            return {}, [[] for _ in ready]
        texts, joints = [], ready[0].arm.assembly.joint_body
        for row, (run, place) in enumerate(zip(ready, places.tolist(), strict=True)):
            own = {name: values[row] for name, values in numbers.items()}
            found = [instrument_warning(carried.instruments, own)]
            if carried.acting.limited:
                since, saturated = carried.acting.saturated()
                loop, angle = run.drive, samples[row][:, 0, joints, 0]
                limits = since, saturated[:, place]
                with self._alone.users:  # the reference may be an object of the user
                    found.append(
                        motor_warning(
                            run.arm, loop.controller, loop.reference, times, angle, limits, own
                        )
                    )
            texts.append(found)
        return numbers, texts

    def _warnings(self, notices: str, run: Ready, place: int, carried: LaneLoop) -> list[str]:
        found = [run.drive.unstable, notices]
        if place in carried.controllers:
            with self._alone.users:
                report = report_of(carried.controllers[place])
            found += [INCONSISTENT] * (report.get("estimator_consistent", 1) == 0)
        return found
