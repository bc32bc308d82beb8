"""Runs under a given torque whose motion is small: tighter tolerances, or a warning.

The default absolute tolerance is a fraction of the reach. Where the whole motion is a small part of
the reach, such as the vibration of a stiff beam, it would be a large part of the motion.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from flexarm.engine.impacts import Checkpoints, run_through_impacts
from flexarm.engine.stepping import Run
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray, Progress, Tolerance

#: Absolute tolerance, in multiples of the relative one times the motion, above which a run with
#: default tolerances is repeated, and that of the second run. In vibrations over 20 periods the
#: error of the first run is then below 1e-4 of the motion, that of the second one below 1e-5.
_LOOSE, _REPEATED = 10.0, 0.1
#: Requested absolute tolerance, relative to the motion, above which a run gets a warning: errors
#: reached 1 % of the motion in vibrations over 20 periods.
_NEAR = 1e-4
#: Number of samples that are examined first: most motions are large.
_PARTS = 16
#: Motion, relative to the reach, that counts as rest: initial states in equilibrium are accurate to
#: this part of the sag, and rounding errors are far smaller.
_REST = 1e-10


def run_accurately(
    run: Run,
    history_of: Callable[[float], PiecewiseCubic],
    checkpoints: Checkpoints | None = None,
) -> None:
    """Simulate under a torque; with the default ``atol``, repeat the run if its motion is small.

    The arguments and the exception are those of ``run_through_impacts``.
    """
    tolerance, start = run.tolerance, _Start(run)
    run_through_impacts(run, history_of, checkpoints)
    if not run.integrator.adaptive:
        return
    samples = run.samples[: run.progress.sample]
    relative = tolerance.relative
    if run.default_atol:
        tighter = tighter_absolute(run.tolerance, relative, samples)
        if tighter is not None:
            evaluations = run.discarded + run.progress.evaluations
            start.restore(run, tolerance._replace(absolute=tighter))
            run_through_impacts(run, history_of, checkpoints)
            run.discarded += evaluations
    else:
        run.doubt = run.doubt or doubt_of(run.tolerance, samples)


def tighter_absolute(tolerance: Tolerance, relative: float, samples: FloatArray) -> float | None:
    """Return the absolute tolerance of a second run; None if one run is accurate enough.

    Args:
        tolerance: of the first run.
        relative: requested relative tolerance.
        samples: (k, 2, n, 1 + m) of the first run.
    """
    motion = _motion(tolerance, samples, tolerance.absolute / (_LOOSE * relative))
    return None if motion is None else _REPEATED * relative * motion


def doubt_of(tolerance: Tolerance, samples: FloatArray) -> str:
    """Return the warning for a requested absolute tolerance near the motion; empty if it is not.

    A relative tolerance that is as large determines the errors, so it needs no warning.

    Args:
        samples: (k, 2, n, 1 + m) of the run.
    """
    motion = _motion(tolerance, samples, tolerance.absolute / max(_NEAR, tolerance.relative))
    if motion is None:
        return ""
    return (
        f"the whole motion moves the tip by {motion * tolerance.scale:.2g} m, near the absolute "
        f"tolerance of a step, atol={tolerance.absolute * tolerance.scale:.2g} m: do not rely on "
        "this result. Reduce atol, or omit it."
    )


def _motion(tolerance: Tolerance, samples: FloatArray, limit: float) -> float | None:
    """Return the largest motion of a coordinate if it is below a limit and the arm is not at rest.

    The motion is a displacement of the tip over ``Tolerance.scale``. Rates count by the motion that
    they cause, because samples may lie at equal phases.
    """
    some = samples[:: max(1, len(samples) // _PARTS)]
    if _largest(tolerance, some) >= limit:
        return None
    motion = _largest(tolerance, samples)
    reach = 1.0 / tolerance.unit[0, :, 0].min()
    return motion if _REST * reach < motion < limit else None


def _largest(tolerance: Tolerance, samples: FloatArray) -> float:
    if not len(samples):
        return 0.0
    moved = np.ptp(samples[:, 0], axis=0) / tolerance.unit[0]
    fast = np.abs(samples[:, 1]).max(axis=0) / tolerance.unit[1]
    return float(max(moved.max(), fast.max()))


class _Start:
    """Values of a run before its first step, from which it can begin again."""

    def __init__(self, run: Run) -> None:
        # The history of prescribed joints sets their start in this array.
        self._array, self._state = run.progress.state, run.progress.state.copy()
        self._loads, self._times, self._duration = run.loads, run.sample_times, run.duration
        self._mark = run.watch.mark() if run.watch is not None else None

    def restore(self, run: Run, tolerance: Tolerance) -> None:
        """Return to the start, with another tolerance."""
        run.begin_again()
        run.tolerance, run.loads = tolerance, self._loads
        run.sample_times, run.duration = self._times, self._duration
        run.samples = np.empty((len(self._times), *self._state.shape))
        self._array[...] = self._state
        run.progress = Progress(0.0, self._array, 0.0)
        run.doubt, run.discarded = "", 0
        if run.watch is not None and self._mark is not None:
            run.watch = replace(run.watch, tolerance=run.tolerance)
            run.watch.restore(self._mark)
