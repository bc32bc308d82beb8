"""Repetition of runs whose whole motion is small beside their absolute tolerance.

The default absolute tolerance is a fraction of the reach. Where the whole motion is a small part of
the reach, such as the vibration of a stiff beam, it would be a large part of the motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.integrate.base import FloatArray, Tolerance
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.impacts import run_through_impacts
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.tolerance import scale_over_reach
from flexarm.simulation.run.work import Checkpoints

#: Absolute tolerance, in multiples of the relative one times the motion, above which a run with
#: default tolerances is repeated, and that of the second run. In vibrations over 20 periods the
#: error of the first run is below 2e-4 of the motion, that of the second one near 1e-5.
_LOOSE, _REPEATED = 10.0, 0.1
#: The same for a requested absolute tolerance, over the motion, unless the relative one is larger.
_NEAR = 1e-4
#: Sum of the allowed errors of all steps, relative to the motion, up to which no run is repeated:
#: short runs are accurate enough.
_SUM = 1e-3
#: Difference of both runs, relative to the motion, above which the requested tolerance gets a
#: warning.
_APART = 1e-2
#: Number of samples that are examined first: most motions are large.
_PARTS = 16
#: Motion, relative to the reach, that counts as rest: initial states in equilibrium are accurate to
#: this part of the sag, and rounding errors are far smaller.
_REST = 1e-10


def run_closely(
    run: Run, history_of: Callable[[float], PiecewiseCubic], checkpoints: Checkpoints | None = None
) -> None:
    """Simulate under a torque; repeat the run if its motion is small beside the tolerance."""
    tolerance, default = run.tolerance, run.settings.atol is None
    beginning = run_through_impacts(run, history_of, checkpoints)
    first = run.samples[: run.progress.sample]
    if not run.integrator.adaptive:
        run.doubt = run.doubt or _doubt_of_search(run, first)
        return
    steps = run.progress.steps
    motion = small_motion(run.arm, run.tolerance, tolerance.relative, default, first, steps)
    if motion is None:
        return
    fine = tolerance._replace(absolute=_REPEATED * tolerance.relative * motion)
    beginning.restore(run, beginning.choice, fine)
    run_through_impacts(run, history_of, checkpoints)
    if not default:
        run.doubt = run.doubt or _doubt(tolerance, run, first, motion)


def small_motion(
    arm: Arm,
    tolerance: Tolerance,
    relative: float,
    default: bool,
    samples: FloatArray,
    steps: int,
) -> float | None:
    """Return the motion in a run that has to be repeated; None if one run is accurate enough."""
    share = _LOOSE * relative if default else max(_NEAR, relative)
    return _motion(arm, tolerance, samples, tolerance.absolute * min(1.0 / share, steps / _SUM))


def _doubt(requested: Tolerance, run: Run, first: FloatArray, motion: float) -> str:
    """Return the warning for a requested absolute tolerance by the samples of the first run."""
    second = run.samples[: run.progress.sample]
    # At rest, the first motion was the tolerance.
    if _motion(run.arm, requested, second, math.inf) is None:
        return ""
    count = min(len(first), len(second))
    apart = np.abs(first[:count, 0] - second[:count, 0]).max(axis=0) / requested.unit[0]
    share = float(apart.max()) / motion
    if share <= _APART:
        return ""
    return (
        f"atol={requested.absolute * requested.scale:.2g} m is near the whole motion of "
        f"{motion * requested.scale:.2g} m at the tip, and would cause errors of {share:.0%} of "
        f"it: the run was repeated with {run.tolerance.absolute * requested.scale:.2g} m. Reduce "
        "atol, or omit it."
    )


def _doubt_of_search(run: Run, samples: FloatArray) -> str:
    """Return the warning for a step that was found for larger motions; empty if it fits."""
    if run.default_step is None:
        return ""
    motion = _motion(run.arm, run.tolerance, samples, math.inf)
    apart, scale = run.default_step.difference, run.tolerance.scale
    if motion is None or apart <= _APART * motion * scale:
        return ""
    return (
        f"the motion differs by {apart:.2g} m from that at twice the step, "
        f"{apart / scale / motion:.0%} of the whole motion of {motion * scale:.2g} m at the tip: "
        "give a shorter step."
    )


def _motion(arm: Arm, tolerance: Tolerance, samples: FloatArray, limit: float) -> float | None:
    """Return the largest motion of a coordinate if it is below a limit and the arm is not at rest.

    The motion is a displacement of the tip over ``Tolerance.scale``. Rates count by the motion that
    they cause, because samples may lie at equal phases.
    """
    stride = max(1, len(samples) // _PARTS)
    motion = _largest(tolerance, samples[::stride])
    if motion < limit and stride > 1:
        motion = _largest(tolerance, samples)
    reach = 1.0 / scale_over_reach(arm.assembly.constants, tolerance.unit)
    return motion if _REST * reach < motion < limit else None


def _largest(tolerance: Tolerance, samples: FloatArray) -> float:
    if not len(samples):
        return 0.0
    moved = np.ptp(samples[:, 0], axis=0) / tolerance.unit[0]
    fast = np.abs(samples[:, 1]).max(axis=0) / tolerance.unit[1]
    return float(max(moved.max(), fast.max()))
