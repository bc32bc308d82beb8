"""Data of a run that every stepper uses: clock, counts, state and samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.kernels.compilation.duals import zeros_like
from flexarm.kernels.layout import Array

#: Indices of ``Memory.clock``. A *span* is the interval between two stops, which a fixed-step
#: method divides into equal steps.
CLOCK_PLACES = 22
(
    TIME,  # s
    STEP,  # s, next step to try; for a method that works in spans, the longest step
    REFUSED,  # 1.0 if the last step was rejected, else 0.0
    NORM,  # error of the present step over the allowed error
    LAST_NORM,  # NORM of the last accepted step, zero without one
    LAST_STEP,  # s, length of the last accepted step
    START,  # s, of the present span
    END,  # s, of the present span
    LENGTH,  # s, of the equal steps of the span
    COUNT,  # number of these steps
    PLACE,  # number of completed steps
    SOFTENED,  # s, step length of the constants of an implicit method
    BETWEEN,  # 1.0 if the last call paused between two steps, else 0.0
    RESUMED,  # s, next step after one that ends at the change of a spring, zero without one
    AHEAD,  # s, from the end of the present step to a change of a spring, zero without one
    CHANGED,  # number, from 1, of the body whose joint sticks or slips at the end of the step, or 0
    RISE,  # N m/s, of the torque beyond the breakaway torque, if it slips
    WHOLE,  # s, step before it was shortened to end there, or 0
    KEPT,  # 1.0 if the momentum of a free mechanism is kept, else 0.0
    MOMENTUM_X,  # N s
    MOMENTUM_Y,
    MOMENTUM_W,  # N m s about the world's origin
) = range(CLOCK_PLACES)

#: Indices of ``Memory.counts``.
COUNT_PLACES = 6
(
    SAMPLES,  # number filled so far
    STEPS,  # accepted
    REJECTED,
    EVALUATIONS,  # of the dynamics
    IMPACTS,  # steps that ended where a joint met or left a stop
    TOUCHES,  # steps that ended where a contact opened or closed
) = range(COUNT_PLACES)


class Memory(NamedTuple):
    """Arrays of one run, common to all methods."""

    clock: Array  # (CLOCK_PLACES,)
    counts: Array  # (COUNT_PLACES,) integers
    state: Array  # (2, n, 1 + m) at ``clock[TIME]``
    new: Array  # (2, n, 1 + m) scratch: state at the end of the present step
    torque: Array  # (n,) scratch
    spare: Array  # (n, 1 + m) scratch
    sample_times: Array  # (samples,) s
    samples: Array  # (samples, 2, n, 1 + m) states at these times


def new_memory(state: Array, step: float) -> Memory:
    """Allocate the memory of a run that starts at ``state`` with a step (s), without samples."""
    clock = np.zeros(CLOCK_PLACES)
    clock[STEP] = step
    return Memory(
        clock=clock,
        counts=np.zeros(COUNT_PLACES, dtype=np.int64),
        state=state,
        new=zeros_like(state, *state.shape),
        torque=zeros_like(state, state.shape[1]),
        spare=zeros_like(state, *state.shape[1:]),
        sample_times=np.zeros(0),
        samples=zeros_like(state, 0, *state.shape),
    )
