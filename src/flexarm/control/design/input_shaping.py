"""Input shapers for the modes of an arm along its motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.base.arguments import check_each, check_kind, check_number
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.linear.vibration.modal import Joints, joint_feedback
from flexarm.linear.vibration.tracking import track_modes
from flexarm.model.checks import checked_arguments
from flexarm.model.scenarios.motions import ShapingSpec
from flexarm.motion.motion import Motion, check_motion
from flexarm.motion.shaping import Clock, Impulses, ShapedMotion, impulses, residual

FloatArray = NDArray[np.float64]

#: Number of postures at which frequencies are computed.
_POSTURES = 49
#: Largest number of iterations, and relative tolerance of the frequencies. Iterations are needed
#: because the frequencies depend on the postures of the shaped motion.
_REPEATED, _SETTLED = 12, 1e-9


@public_call
def shaped(
    motion: Motion,
    arm: Arm | None = None,
    method: str = "zvd",
    *,
    modes: int | Sequence[int] = 1,
    joints: Joints = "locked",
    frequency_hz: ArrayLike | None = None,
    damping_ratio: ArrayLike | None = None,
    tolerance: float = 0.05,
    insensitivity: float = 0.5,
) -> ShapedMotion:
    """Shape a motion to cancel residual vibration, by a sum of delayed copies.

    Args:
        motion: the original motion.
        arm: the arm whose modes are to be cancelled.
        method: "zv" for zero vibration at the design frequencies; "zvd", and more so "zvdd", for
            small vibration near them as well; "ei" for at most ``tolerance`` over a wider range;
            "si" for at most ``tolerance`` in the range ``insensitivity``.
        modes: number of the lowest modes, or mode numbers counted from 1. Each mode lengthens the
            motion by half a period (zv), a period (zvd, ei), one and a half (zvdd), or as long as
            the range requires (si).
        joints: condition of the joints, as in `flexarm.modes`, for example the gains of the
            controller.
        frequency_hz: natural frequencies in Hz, one or several, that replace those of the arm's
            modes, which change with posture along the motion.
        damping_ratio: below 1, one number or one for each mode; by default the mean damping ratio
            of each mode along the motion, or zero if frequencies are given.
        tolerance: for "ei": residual vibration at the design frequency, relative to that after a
            single impulse; for "si": largest one in the range; between 0 and 1.
        insensitivity: for "si": width of the range of frequencies, relative to the design
            frequency in its middle; at most 1.

    Returns:
        The shaped motion. Its tip deviates from the path, because the joint angles are summed and
        the path is not linear in them.

    Raises:
        InputError: if an argument has the wrong value, neither an arm nor frequencies are given, or
            both ``modes`` and frequencies; if a mode is overdamped along the motion; or if the
            search for the impulses of "si" fails.

    Impulse times follow the phase of the vibration along the shaped motion, (C.7). Several modes
    are shaped one after another.
    """
    motion = check_motion(motion)
    vibration = {"modes": modes, "frequency_hz": frequency_hz, "damping_ratio": damping_ratio}
    widths = {"tolerance": tolerance, "insensitivity": insensitivity}
    options = checked_arguments(ShapingSpec, method=method, **vibration, **widths)
    if arm is not None and check_kind("arm", arm, Arm).n_joints != motion.joints:
        rule = f"have the number of joints of the motion ({motion.joints})"
        raise InputError(Problem("arm", rule, f"{arm.n_joints}"))
    if options.frequency_hz is None:
        if arm is None:
            raise InputError(Problem("arm", "is required if there is no frequency_hz"))
        return _by_modes(motion, arm, options, joints)
    frequencies = np.array(options.frequency_hz, dtype=np.float64, ndmin=1)
    ratios = _ratios(options.damping_ratio or 0.0, len(frequencies))
    for hertz, ratio in zip(frequencies, ratios, strict=True):
        rates = np.full(6, 2.0 * np.pi * hertz * np.sqrt(1.0 - ratio**2))
        times = np.linspace(motion.start_time, motion.end_time, 6)
        motion = ShapedMotion(motion, *_impulses(options, ratio), Clock(times, rates))
    assert isinstance(motion, ShapedMotion)
    return motion


def _by_modes(motion: Motion, arm: Arm, options: ShapingSpec, joints: Joints) -> ShapedMotion:
    """Iterate until the frequencies are those along the motion that is shaped with them."""
    chosen = _chosen(options.modes, arm)
    joint_feedback(arm, joints)  # names this function if the argument is wrong
    unshaped, made = motion, motion
    before = np.zeros((_POSTURES, len(chosen)))
    for _ in range(_REPEATED):
        along = track_modes(arm, made, joints, count=int(chosen.max()) + 1, samples=_POSTURES)
        hertz, own = along.frequency_hz[:, chosen], along.damping_ratio[:, chosen]
        _check_vibration(chosen, own)
        given = options.damping_ratio
        ratios = _ratios(own.mean(axis=0) if given is None else given, len(chosen))
        if np.max(np.abs(hertz / np.where(before > 0.0, before, 1.0) - 1.0)) < _SETTLED:
            break
        before, motion = hertz, unshaped
        for column, ratio in zip(hertz.T, ratios, strict=True):
            clock = Clock(along.parameter, 2.0 * np.pi * column * np.sqrt(1.0 - ratio**2))
            motion = ShapedMotion(motion, *_impulses(options, ratio), clock)
        made = motion
    assert isinstance(made, ShapedMotion)
    return made


@public_call
def shaper_sensitivity(
    frequency_ratio: ArrayLike,
    method: str = "zvd",
    *,
    damping_ratio: float = 0.0,
    tolerance: float = 0.05,
    insensitivity: float = 0.5,
) -> FloatArray:
    """Return the vibration that a shaper leaves at other frequencies than its design frequency.

    Args:
        frequency_ratio: (k,) frequencies of the arm over the design frequency, positive.
        method, tolerance, insensitivity: of the shaper, as in `shaped`.
        damping_ratio: of the design and of the arm, below 1.

    Returns:
        (k,) amplitudes relative to the initial one after a single impulse; (C.3).

    Raises:
        InputError: if an argument has the wrong value, or the search for the impulses of "si"
            fails.
    """
    ratios = np.atleast_1d(check_each("frequency_ratio", frequency_ratio, positive=True))
    ratio = check_number("damping_ratio", damping_ratio)
    widths = {"tolerance": tolerance, "insensitivity": insensitivity}
    options = checked_arguments(ShapingSpec, method=method, damping_ratio=ratio, **widths)
    return residual(_impulses(options, ratio), ratio, ratios)


def _impulses(options: ShapingSpec, ratio: float) -> Impulses:
    return impulses(options.method, float(ratio), options.tolerance, options.insensitivity)


def _chosen(modes: int | Sequence[int], arm: Arm) -> NDArray[np.intp]:
    """Return the indices (from 0) of the modes to shape for."""
    most = arm.dof - arm.n_joints
    if most == 0:
        raise InputError(Problem("arm", "has no bending modes"))
    numbers = range(1, modes + 1) if isinstance(modes, int) else modes
    if not numbers or max(numbers) > most or len(set(numbers)) < len(numbers):
        rule = f"be different numbers from 1 to {most} (the bending modes of the arm)"
        raise InputError(Problem("modes", rule, shown(modes)))
    return np.array(numbers, dtype=np.intp) - 1


def _check_vibration(chosen: NDArray[np.intp], ratios: FloatArray) -> None:
    """Raise if the damping ratios (postures, modes) of a mode reach 1."""
    most = ratios.max(axis=0)
    wrong = [
        f"mode {number + 1} with the damping ratio {ratio:.3g}"
        for number, ratio in zip(chosen, most, strict=True)
        if not ratio < 1.0
    ]
    if wrong:
        hint = "Leave such modes out by a list of mode numbers, or change the joints."
        rule = "be vibrations, with damping ratios below 1 along the motion"
        raise InputError(Problem("modes", rule, ", ".join(wrong), hint))


def _ratios(given: ArrayLike, count: int) -> FloatArray:
    ratios = np.asarray(given, dtype=np.float64)
    if ratios.ndim and ratios.size != count:
        rule = f"be one number, or one for each of the {count} modes"
        raise InputError(Problem("damping_ratio", rule, f"{ratios.size} numbers"))
    return np.broadcast_to(ratios, (count,))
