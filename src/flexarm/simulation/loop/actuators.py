"""Actuators of the sampled loop: hold, delay, saturation and lag of commanded torques."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import InputError, Problem
from flexarm.control.contract.gains import joint_problems
from flexarm.integrate.base import FloatArray
from flexarm.model import Hardware, Motors
from flexarm.model.hardware import LIMITS

#: A first-order lag is approximated by cubics over this fraction of its time constant, up to this
#: many time constants, within 1e-5 and 5e-5 of the change of torque.
_PIECE, _SETTLED = 0.25, 10.0


class Acting:
    """Motors between the sample times of a controller.

    From each time in ``since`` on, the applied torque changes from ``initial`` to ``target`` with
    the factor ``1 - exp(-(t - since) / time_constant)``. Without ``keep`` only the last change is
    stored. The motors of several runs with the same sample times have torques (runs, joints)
    instead of (joints,).
    """

    def __init__(
        self, hardware: Hardware | None, arm: Arm, keep: bool = True, runs: int | None = None
    ) -> None:
        joints = arm.joints
        given = hardware.motors if hardware is not None else None
        self.plain = given is None  # the commanded torque acts immediately
        self._motors = given or Motors()
        limits = {f"hardware.motors.{name}": getattr(self._motors, name) for name in LIMITS}
        problems = joint_problems(joints, limits)
        if self._motors.back_voltage and any(joint.winding for joint in arm.spec.joints):
            rule = "is not supported for joints with a winding"
            hint = "Their torque is that at standstill: give its limit as torque_limit."
            problems.append(Problem("hardware.motors.voltage_limit", rule, hint=hint))
        if problems:
            raise InputError(*problems)
        self._lag = self._motors.time_constant
        self._waiting: deque[tuple[float, FloatArray]] = deque()
        self._since: list[float] = []
        self._initial: list[FloatArray] = []
        self._target: list[FloatArray] = []
        self._requested: list[FloatArray] = []
        self._nothing = np.zeros(joints if runs is None else (runs, joints))
        self._keep = keep

    @property
    def limited(self) -> bool:
        """Whether the torque of any motor has a limit."""
        motors = self._motors
        limits = motors.torque_limit, motors.current_limit, motors.voltage_limit
        return any(np.isfinite(limit).any() for limit in limits)

    @property
    def pieces(self) -> int:
        """Number of cubics for the torque over one hold interval."""
        return 1 if self._lag == 0.0 else round(_SETTLED / _PIECE) + 1

    @property
    def target(self) -> FloatArray:
        """Torque (joints,) that the motors currently approach."""
        return self._target[-1]

    def command(self, t: float, torque: FloatArray) -> None:
        """Command a torque (joints,) at time t."""
        self._waiting.append((t + self._motors.delay, torque))

    def next_change(self, t: float, until: float) -> float:
        """Return the time at which the commanded torque changes next, at most ``until``."""
        for due, _ in self._waiting:
            if due > t:
                return min(due, until)
        return until

    def hold(self, t: float, rate: FloatArray | None) -> None:
        """Apply the command that is due at time t.

        Args:
            rate: joint rates (joints,) at that time, rad/s; not needed by ``plain`` motors.
        """
        due = None
        # A command that is due later by rounding alone is due now.
        while self._waiting and self._waiting[0][0] <= t * (1.0 + 1e-12):
            due = self._waiting.popleft()[1]
        if due is None and self._since:
            return
        now = self._now(t) if self._since and self._lag > 0.0 else self._nothing
        target = self._nothing if due is None else due
        if rate is not None:
            target = self._motors.allowed(target, rate)
        if not self._keep:
            for past in (self._since, self._initial, self._target, self._requested):
                past.clear()
        self._since.append(t)
        self._requested.append(self._nothing if due is None else due)
        self._initial.append(now if self._lag > 0.0 else target)
        self._target.append(target)

    def cubics(self, t: float, until: float) -> tuple[FloatArray, FloatArray]:
        """Return the torque from t to ``until``: breaks (pieces + 1,) and coefficients.

        The coefficients have shape (pieces, 4, joints).
        """
        start, target = self._now(t), self._target[-1]
        count, lag = self.pieces, self._lag
        numbers = np.result_type(start, target)  # complex in derivatives of runs
        coefficients = np.zeros((count, 4, *target.shape), dtype=numbers)
        coefficients[:, 0] = target
        if lag == 0.0:
            return np.array([t, until]), coefficients
        followed = min(until - t, _SETTLED * lag)
        breaks = np.append(t + followed / (count - 1) * np.arange(count), max(until, t + followed))
        # Torque that remains at each break.
        left = np.multiply.outer(np.exp(-(breaks - t) / lag), target - start)
        h = followed / (count - 1)
        rise, slope, slope_after = left[:-1] - left[1:], left[:-1] / lag, left[1:] / lag
        coefficients[:-1, 0] -= left[:-2]
        coefficients[:-1, 1] = slope[:-1]
        coefficients[:-1, 2] = (3.0 * rise / h - 2.0 * slope - slope_after)[:-1] / h
        coefficients[:-1, 3] = (slope + slope_after - 2.0 * rise / h)[:-1] / h**2
        coefficients[-1, 0] -= left[-2]
        if breaks[-1] == breaks[-2]:  # breaks must increase, even if the last piece is empty
            breaks[-1] += lag
        return breaks, coefficients

    def saturated(self) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the times (k,) s of all changes, and which motors (k, joints) are at a limit."""
        requested, target = np.asarray(self._requested), np.asarray(self._target)
        return np.asarray(self._since), requested != target

    def _now(self, t: float) -> FloatArray:
        """Return the torque (joints,) at a time t since the last change."""
        if self._lag == 0.0:
            return self._target[-1]
        left = math.exp(-(t - self._since[-1]) / self._lag)
        return self._target[-1] + (self._initial[-1] - self._target[-1]) * left

    def at(self, times: FloatArray) -> FloatArray:
        """Return the applied torque (T, joints) at times (T,)."""
        since = np.asarray(self._since)
        index = np.clip(np.searchsorted(since, times * (1.0 + 1e-12), side="right") - 1, 0, None)
        target = np.asarray(self._target)[index]
        if self._lag == 0.0:
            return target
        left = np.exp(-np.maximum(times - since[index], 0.0) / self._lag)
        left = left.reshape(-1, *(1,) * self._nothing.ndim)
        held: FloatArray = target + (np.asarray(self._initial)[index] - target) * left
        return held
