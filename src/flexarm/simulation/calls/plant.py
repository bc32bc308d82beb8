"""Simulation of an arm one sample time at a time, for your own control loop."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.actions import BaseAcceleration, Environment
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import turning_joints
from flexarm.arm.observe import contact_forces
from flexarm.base.arguments import (
    check_count,
    check_kind,
    warn_of_degrees,
)
from flexarm.base.errors import (
    AccuracyWarning,
    InputError,
    LargeDeflectionWarning,
    Problem,
    SimulationError,
    check_array,
    public_call,
    warn_caller,
)
from flexarm.control.hardware.measurement import Measurement
from flexarm.integrate.base import FloatArray
from flexarm.model import Change, Contact, Hardware, Load
from flexarm.model.quantities import Flag, Positive
from flexarm.simulation.calls.preparation import check_loops, initial_state, new_run
from flexarm.simulation.loop.control_loop import RunLoop
from flexarm.simulation.loop.devices import TipMotion
from flexarm.simulation.run.contacts import refuse_deep_start
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import (
    PlantSettings,
    RunSettings,
    replaced,
    settings_of,
    with_keywords,
)
from flexarm.simulation.run.validity import BendingWatch


class Plant:
    """Arm with its hardware, simulated step by step, for your own control loop.

    The plant starts at time zero, at rest, with straight links and all joint angles zero. ``step``
    applies a torque until the next sample time and returns the readings of the sensors there. The
    loop of ``flexarm.simulate`` uses the same code, so the results agree to the last digit. Nothing
    is recorded, and no second run estimates the error through impacts: compare plants of different
    tolerances for that. A copy (``copy.deepcopy``, ``pickle``) continues independently from the
    current state; a pickle cannot contain a load or base acceleration that is a lambda function.

    Args:
        arm: the simulated arm.
        sample_time: s from one step to the next.
        hardware: instruments and motors; None for exact sensors of joint angles, rates and strain,
            and motors that apply the commanded torque exactly.
        tip_force, loads, base_acceleration, contacts: external actions, see ``flexarm.simulate``.
        changes: numbers of the arm that change after each reset, at times, see ``Change``.
        breaks: times (s) at which loads or a base acceleration that are functions of time jump or
            have a kink.
        integrator, step, accuracy, rtol, atol: method and accuracy, see ``flexarm.simulate``; no
            second run verifies the accuracy.
        settings: these, ``breaks`` and ``specialized`` as one object, see ``flexarm.RunSettings``.
        duration: s, latest time of a step; None for no limit. Required if loads or the base
            acceleration are functions of time, which are evaluated in advance.
        specialized: True compiles the hot loop for the sizes of this arm: several seconds, once per
            size and machine, then a third faster.
        warn: whether to warn of a fixed step that is too long for friction, and in ``step`` of
            large deflections; ``warning`` has the text of these in any case.

    Attributes:
        arm, sample_time: as given.
        duration: s, latest time of a step; infinite without a limit.
        measurement: readings of the sensors at the current sample time.
        warning: link that has exceeded the linear theory since the reset, or empty text.

    Raises:
        InputError: if an argument has the wrong shape, is not finite, or contradicts another.

    Warns:
        AccuracyWarning: if a fixed step is too long for friction.
    """

    @public_call
    @with_keywords(PlantSettings)
    def __init__(
        self,
        arm: Arm,
        sample_time: Positive = 1e-3,
        hardware: Hardware | None = None,
        *,
        tip_force: ArrayLike | None = None,
        loads: Sequence[Load] = (),
        base_acceleration: BaseAcceleration | None = None,
        contacts: Sequence[Contact] = (),
        changes: Sequence[Change] = (),
        duration: Positive | None = None,
        specialized: Flag = False,
        warn: Flag = True,
        settings: RunSettings | None = None,
        **keywords: Unpack[PlantSettings],
    ) -> None:
        if hardware is not None:
            check_kind("hardware", hardware, Hardware, "a Hardware object")
        self.arm, self.sample_time = arm, sample_time
        checked = settings_of(settings, keywords, Plant.__init__)
        compiled = specialized or bool(settings and settings.specialized)
        environment = Environment.of(arm, tip_force, loads, base_acceleration, contacts)
        if duration is None:
            factors = [environment.base_acceleration, *(load.factor for load in environment.loads)]
            if any(map(callable, factors)):
                rule = "is required with loads or a base acceleration that are functions of time"
                hint = "Tables (times, values) do not need it."
                raise InputError(Problem("duration", rule, hint=hint))
        self.duration = math.inf if duration is None else duration
        self._hardware, self._warn = hardware, warn
        self._bending, self._tip = BendingWatch(arm), TipMotion(arm)
        settings, meter = replaced(checked, specialized=compiled), Meter("stepping", False)
        span = settings, self.duration, np.zeros(0), self.sample_time
        self._given = *span, environment, meter, None, changes
        self._reset(None, None, None)
        if self._loop.run.doubt and warn:
            warn_caller(self._loop.run.doubt, AccuracyWarning)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state for copies and pickles; helpers of the arm are created again."""
        return {k: v for k, v in self.__dict__.items() if k not in ("_bending", "_tip")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bending, self._tip = BendingWatch(self.arm), TipMotion(self.arm)

    @public_call
    def reset(
        self,
        initial: ArrayLike | None = None,
        initial_rate: ArrayLike | None = None,
        seed: int | None = None,
    ) -> Measurement:
        """Return to time zero and return the readings of the sensors there.

        Args:
            initial: q (dof,), by default straight links and all joint angles zero.
            initial_rate: qd (dof,), zero by default. Bristles of friction start without deflection,
                so q and qd alone do not restore a plant with them; `copy.deepcopy` does.
            seed: of the instruments' noise, instead of the hardware's seed.

        Raises:
            InputError: if an argument has the wrong shape or is not finite, or the initial state
                is deep inside a surface.
        """
        return self._reset(initial, initial_rate, seed)

    def _reset(
        self, initial: ArrayLike | None, initial_rate: ArrayLike | None, seed: int | None
    ) -> Measurement:
        arm, hardware = self.arm, self._hardware
        straight = np.zeros(arm.n_joints)
        state = initial_state(arm, initial, initial_rate, straight)
        check_loops(arm, state)
        if seed is not None:
            check_count("seed", seed, least=0, most=2**63 - 1)
        if hardware is not None and seed is not None:
            hardware = hardware.replace(seed=seed)
        run = new_run(arm, state, *self._given)
        run.loads_of = None  # a plant repeats no run, and a user's function cannot be pickled
        if initial is not None:
            warn_of_degrees(initial=arm.joint_angles(initial)[turning_joints(arm)])
            refuse_deep_start(arm, state, run.loads.placed.contacts)
        self._loop = RunLoop(run, self.sample_time, hardware, keep=False)
        self._stopped_at: float | None = None
        self.warning = ""
        self.measurement = self._loop.measure()
        return self.measurement

    @public_call
    def step(self, torque: ArrayLike) -> Measurement:
        """Apply a torque (joints,) N m for one sample time and return the readings after it.

        Raises:
            InputError: if the torque has the wrong shape or is not finite, the step exceeds the
                plant's duration, or the initial state is deep inside a surface; the state does
                not change.
            SimulationError: if the integration fails before the next sample time; ``.state`` is
                the last valid one. Call ``reset`` before the next step.

        Warns:
            LargeDeflectionWarning: if a link exceeds the linear beam theory; once after each
                reset.
        """
        loop = self._loop
        command = check_array("torque", torque, (self.arm.n_joints,))
        until = (loop.tick + 1) * self.sample_time
        if self._stopped_at is not None:
            rule = f"stopped at t = {self._stopped_at:.6g} s and must be reset"
            raise InputError(Problem("the plant", rule))
        # The sum of the sample times may exceed the duration by rounding.
        if until > self.duration * (1.0 + 1e-12):
            rule = f"be at most the duration of the plant ({self.duration:.6g} s)"
            raise InputError(Problem("the next sample time", rule, f"{until:.6g} s"))
        if loop.tick == 0:  # not in __init__, because a reset may first move the arm
            start, contacts = loop.run.progress.state, loop.run.loads.placed.contacts
            refuse_deep_start(self.arm, start, contacts)
        try:
            loop.hold(command)
        except SimulationError as error:
            self._stopped_at = error.time
            raise
        self.measurement = loop.measure()
        if not self.warning:
            self.warning = self._bending(loop.run.progress.state)
            if self.warning and self._warn:
                warn_caller(self.warning, LargeDeflectionWarning)
        return self.measurement

    def __repr__(self) -> str:
        return f"<flexarm.Plant: {self.arm.n_links} links at {self.time:.5g} s>"

    @property
    def time(self) -> float:
        """Current sample time, s; after a failure the time reached."""
        return self._loop.time if self._stopped_at is None else self._stopped_at

    @property
    def q(self) -> FloatArray:
        """Coordinates (dof,)."""
        return self._loop.run.state()[0]

    @property
    def qd(self) -> FloatArray:
        """Rates of the coordinates (dof,)."""
        return self._loop.run.state()[1]

    @property
    def tip_motion(self) -> FloatArray:
        """Values of ``tip``, then of ``tip_velocity``, (6,)."""
        return self._tip(self._loop.run.progress.state).copy()

    @property
    def tip(self) -> FloatArray:
        """World position x, y (m) and angle (rad) of the tip, (3,)."""
        return self.tip_motion[:3]

    @property
    def tip_velocity(self) -> FloatArray:
        """Rates of ``tip``, (3,)."""
        return self.tip_motion[3:]

    @property
    def saturated(self) -> NDArray[np.bool_]:
        """Whether each motor is at its limit, (joints,), during the last step; for anti-windup."""
        _, saturated = self._loop.acting.saturated()
        return saturated[-1] if len(saturated) else np.zeros(self.arm.n_joints, dtype=bool)

    @property
    def contact_force(self) -> FloatArray:
        """Forces (contacts, 2) of contacts on the arm, N, world axes."""
        run = self._loop.run
        state = run.progress.state[None]
        return np.asarray(contact_forces(self.arm, run.loads.placed.contacts, state)[0])
