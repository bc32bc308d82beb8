"""Tracking of modes along postures, a motion, or increasing spin, by similarity of their shapes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.bending import one_warning, warn_of_bending
from flexarm.base.arguments import check_count
from flexarm.base.errors import InputError, Problem, check_array, few, public_call, shown
from flexarm.base.late import optimize
from flexarm.linear.statics.equilibrium import equilibrium
from flexarm.linear.vibration.modal import Joints, Modes, modes
from flexarm.model.arm.spec import serial_only
from flexarm.model.quantities import Count, Flag
from flexarm.motion import Motion

#: Minimum similarity of the shapes at neighbouring samples; below it the interval is halved.
_ALIKE = 0.8
_MOST_HALVINGS = 8
_SAMPLES = 101


@dataclass(frozen=True, eq=False)
class ModeTracks:
    """Modes tracked along a parameter; column j is the same mode at all samples.

    Attributes:
        parameter: (s,) values of the ``parameter_name`` in ``parameter_unit``.
        frequency_hz: (s, k) undamped; for a spinning arm the moduli of the eigenvalues over 2 pi.
        damping_ratio: (s, k).
        eigenvalues: (s, k) 1/s, complex.
        shapes: (s, k, dof) of the damped motion.
        similarity: (s, k) of the shape to that at the previous sample, 0 to 1, (S.6); one at the
            first sample.
    """

    parameter: FloatArray
    parameter_name: str
    parameter_unit: str
    frequency_hz: FloatArray
    damping_ratio: FloatArray
    eigenvalues: NDArray[Any]
    shapes: NDArray[Any]
    similarity: FloatArray
    references: ClassVar[str] = "AllemangBrown1982 SquireTrapp1998"

    def __repr__(self) -> str:
        ends = f"{self.parameter[0]:.4g} to {self.parameter[-1]:.4g} {self.parameter_unit}".strip()
        samples, modes = self.frequency_hz.shape
        return (
            f"<flexarm.ModeTracks: {modes} modes at {samples} samples, {self.parameter_name} "
            f"{ends}, from {few(self.frequency_hz[0])} Hz>"
        )


@public_call
def track_modes(
    arm: Arm,
    along: ArrayLike | Motion,
    joints: Joints = "locked",
    *,
    count: Count = 6,
    samples: int = _SAMPLES,
    sag: Flag = False,
) -> ModeTracks:
    """Track modes of vibration along postures or a motion.

    Args:
        arm: the arm.
        along: joint angles (s, joints) rad, or a motion such as that of `line_motion` or
            `joint_motion`, evaluated at ``samples`` times. The parameter is the number of the
            posture or the time (s), respectively.
        joints: as in `modes`.
        count: number of modes, from the lowest that is not a rigid-body mode at the first posture.
        samples: number of postures along a motion.
        sag: compute modes about the equilibrium under gravity at each posture, instead of about
            straight links.

    Raises:
        InputError: if the postures have the wrong shape, or ``count`` is less than one.
        EquilibriumError: if ``sag`` is set and a posture has no equilibrium.

    Each mode is continued by the mode with the most similar shape. If none is similar enough,
    intermediate postures are evaluated. Two curves that approach each other and separate again
    (veering) exchange their shapes gradually, and are tracked as the curves that they are.
    """
    samples = check_count("samples", samples, least=2)
    motion: Any = along
    if isinstance(along, type):
        raise InputError(Problem("along", "be a motion or joint angles", shown(along)))
    if hasattr(motion, "joint_angle"):
        parameter = np.linspace(motion.start_time, motion.end_time, samples)
        angles = np.asarray(motion.joint_angle(parameter))
        postures = check_array("along", angles, (-1, arm.n_joints))
        name, unit = "time", "s"
    else:
        postures = check_array("along", along, (-1, arm.n_joints))
        parameter = np.arange(len(postures), dtype=np.float64)
        name, unit = "posture", ""

    def solve(at: float) -> Modes:
        angles = np.array([np.interp(at, parameter, column) for column in postures.T])
        return modes(arm, equilibrium(arm, angles) if sag else angles, joints)

    return _follow(arm, solve, parameter, count, (name, unit))


@public_call
def campbell(
    arm: Arm,
    spin: ArrayLike,
    joint_angles: ArrayLike | None = None,
    joints: Joints = "locked",
    *,
    count: Count = 4,
) -> ModeTracks:
    """Track modes of an arm that rotates as a whole at increasing spin (Campbell diagram).

    Args:
        arm: the arm, without gravity. Spin stiffens links only with ``theory="second_order"``.
        spin: (s,) rad/s, ascending.
        joint_angles, joints: as in `modes`.
        count: number of modes, from the lowest that is not a rigid-body mode at the first spin.

    Raises:
        InputError: if the arm has gravity, its first joint is fixed, or ``count`` is less than one.
        EquilibriumError: if the arm has no steady shape at some spin.
    """
    rates = check_array("spin", spin, (-1,))
    serial_only(arm.spec, "a spin")

    def solve(at: float) -> Modes:
        return modes(arm, joint_angles, joints, spin=at)

    return _follow(arm, solve, rates, count, ("spin", "rad/s"))


def _follow(
    arm: Arm,
    solve: Callable[[float], Modes],
    parameter: FloatArray,
    count: int,
    named: tuple[str, str],
) -> ModeTracks:
    if parameter.size == 0 or np.any(np.diff(parameter) <= 0.0):
        rule = "be one or more numbers in increasing order"
        raise InputError(Problem(named[0], rule, shown(parameter)))
    bent: list[FloatArray] = []

    def solved(at: float) -> Modes:
        with one_warning(report=False):
            found = solve(at)
        bent.append(found.q)
        return found

    first = solved(float(parameter[0]))
    vibrating = np.flatnonzero(first.frequency_hz > 0.0)
    if vibrating.size == 0:
        raise InputError(Problem("arm", "has no mode of vibration"))
    chosen = vibrating[:count]
    lines = _Lines(arm, first.complex_shapes[chosen])
    rows = [_row(first, chosen, np.ones(chosen.size))]
    for before, at in pairwise(parameter):
        found, chosen, alike = _step(lines, solved, float(before), float(at), 0)
        rows.append(_row(found, chosen, alike))
    warn_of_bending(arm, np.array(bent))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return ModeTracks(parameter, *named, *columns)


def _row(found: Modes, chosen: NDArray[np.intp], alike: FloatArray) -> tuple[Any, ...]:
    columns = found.frequency_hz, found.damping_ratio, found.eigenvalues, found.complex_shapes
    return *(column[chosen] for column in columns), alike


class _Lines:
    """The tracked shapes, each from the last sample with a clear match."""

    def __init__(self, arm: Arm, shapes: NDArray[Any]) -> None:
        self.arm, self.shapes = arm, shapes

    def match(self, found: Modes) -> tuple[NDArray[np.intp], FloatArray]:
        """Return the mode that continues each tracked mode, and their similarity: (S.6)."""
        M = self.arm.mass_matrix(found.q)
        theirs = found.complex_shapes
        products = np.abs(self.shapes.conj() @ M @ theirs.T) ** 2
        mine = np.einsum("ki,ij,kj->k", self.shapes.conj(), M, self.shapes).real
        other = np.einsum("ki,ij,kj->k", theirs.conj(), M, theirs).real
        alike = products / np.outer(mine, other)
        rows, columns = optimize.linear_sum_assignment(alike, maximize=True)
        return columns, alike[rows, columns]

    def take(self, found: Modes, chosen: NDArray[np.intp], alike: FloatArray) -> None:
        """Update the tracked shapes, except where modes cross and the match is not clear."""
        clear = alike >= _ALIKE
        self.shapes = np.where(clear[:, None], found.complex_shapes[chosen], self.shapes)


def _step(
    lines: _Lines, solve: Callable[[float], Modes], before: float, at: float, depth: int
) -> tuple[Modes, NDArray[np.intp], FloatArray]:
    """Advance to the next parameter, halving the interval if shapes change too much."""
    found = solve(at)
    chosen, alike = lines.match(found)
    if alike.min() < _ALIKE and depth < _MOST_HALVINGS:
        middle = 0.5 * (before + at)
        _step(lines, solve, before, middle, depth + 1)
        return _step(lines, solve, middle, at, depth + 1)
    lines.take(found, chosen, alike)
    return found, chosen, alike
