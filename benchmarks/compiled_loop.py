"""Forward dynamics merged into a compiled loop, as in an integrator: no Python in the timing."""

from __future__ import annotations

import numpy as np

import flexarm as fa
from flexarm.kernels.compilation.cache import compiled
from flexarm.kernels.layout import (
    Sizes,
    compile_time_sizes,
    new_workspace,
    no_loads,
    run_time_sizes,
)
from flexarm.kernels.recursion.articulated_body import solve_forward


@compiled
def _repeat(sizes, constants, state, torque, loads, work, calls):  # type: ignore[no-untyped-def]
    for _ in range(calls):
        solve_forward(sizes, constants, state, torque, loads, work)
        # Feed the result back: otherwise the compiler may remove all calls but one.
        state[0, 0, 0] += 1e-12 * work.acceleration[0, 0]


class ForwardDynamics:
    """Repeat the forward dynamics of an arm at a state, with run-time or compile-time sizes."""

    def __init__(self, arm: fa.Arm, q: np.ndarray, qd: np.ndarray, torque: np.ndarray) -> None:
        self._constants = arm.assembly.constants
        self._state = arm.padded(np.stack([q, qd]))
        self._torque = arm.padded_torque(torque)
        self._unloaded = no_loads(self._constants)
        self._work = new_workspace(self._constants)

    def run_time_sizes(self) -> Sizes:
        """Return sizes as run-time values: one compilation serves all arms."""
        return run_time_sizes(self._constants)

    def compile_time_sizes(self) -> Sizes:
        """Return sizes that are constants of the machine code."""
        return compile_time_sizes(self._constants)

    def __call__(self, sizes: Sizes, calls: int) -> None:
        c = self._constants
        _repeat(sizes, c, self._state, self._torque, self._unloaded, self._work, calls)
