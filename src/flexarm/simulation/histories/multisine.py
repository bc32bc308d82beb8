"""Multisines: periodic torques for frequency responses and identification.

Schroeder, IEEE Transactions on Information Theory 16 (1970) 85, for the phases; Dobrowiecki,
Schoukens and Guillaume, IEEE Transactions on Instrumentation and Measurement 55 (2006) 1747, for
orthogonal multisines.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.base.arguments import (
    check_each,
    check_nonnegative,
    check_positive,
    check_times,
)
from flexarm.base.errors import InputError, Problem, check_array, public_call, shown
from flexarm.model.quantities import Count, NonNegative, Positive
from flexarm.model.scenarios.scenario import sample_fault
from flexarm.simulation.histories.piecewise import FloatArray

#: Highest harmonic, and points per period of it at which peaks are found.
_HIGHEST, _POINTS = 100_000, 16
#: Most values of sines that are computed together, which bounds the memory.
_TOGETHER = 1_000_000


@dataclass(frozen=True, eq=False)
class Multisine:
    """Torque that is a sum of sines with a common period; callable with the time.

    u(t) = r(t) Re sum_k coefficients[k] exp(2 pi i harmonics[k] t / period), where r rises smoothly
    from 0 to 1 during the first ``rise`` seconds.

    Args:
        period: s.
        harmonics: (lines,) whole numbers from 1 to 100000: the frequencies are harmonics / period.
        coefficients: (lines, joints) complex amplitudes, N m.
        rise: s; 0 for a start at full amplitude.

    Raises:
        InputError: if a shape or a value is wrong.
    """

    #: Whether the torque accepts an array of times, for ``simulate``.
    vectorized: ClassVar[bool] = True

    period: float
    harmonics: NDArray[np.intp]
    coefficients: NDArray[np.complex128]
    rise: float = 0.0

    @public_call
    def __post_init__(self) -> None:
        lines = check_array("harmonics", self.harmonics, (-1,))
        fits = (lines == np.rint(lines)) & (lines >= 1.0) & (lines <= _HIGHEST)
        if not lines.size or not fits.all():
            rule = f"be whole numbers from 1 to {_HIGHEST}"
            raise InputError(Problem("harmonics", rule, shown(self.harmonics)))
        shape = lines.size, -1
        given = self.coefficients
        if isinstance(given, np.ndarray) and given.dtype.kind == "c":
            parts = given.real, given.imag
            real, imaginary = (check_array("coefficients", part, shape) for part in parts)
            given = real + 1j * imaginary
        else:
            given = check_array("coefficients", given, shape).astype(np.complex128)
        if not given.size:
            raise InputError(Problem("coefficients", "must not be empty"))
        period, rise = check_positive("period", self.period, "s"), self.rise
        vars(self).update(period=period, rise=check_nonnegative("rise", rise))
        vars(self).update(harmonics=lines.astype(np.intp), coefficients=given)

    def __repr__(self) -> str:
        low, high = self.frequency_hz[[0, -1]]
        about = f"{self.harmonics.size} sines from {low:g} to {high:g} Hz"
        return f"<flexarm.Multisine: {about}, period {self.period:g} s, {self.joints} joints>"

    @property
    def joints(self) -> int:
        """Number of joints."""
        return int(self.coefficients.shape[1])

    @property
    def frequency_hz(self) -> FloatArray:
        """Frequencies (lines,), Hz."""
        return self.harmonics / self.period

    @property
    def breaks(self) -> tuple[float, ...]:
        """Times (s) at which a derivative of the torque jumps."""
        return (self.rise,) if self.rise else ()

    @property
    def peak(self) -> FloatArray:
        """Largest magnitude (joints,) within a period, N m."""
        points = _POINTS * int(self.harmonics.max())
        spectrum = np.zeros((points // 2 + 1, self.joints), dtype=np.complex128)
        np.add.at(spectrum, self.harmonics, 0.5 * points * self.coefficients)
        return np.asarray(np.abs(np.fft.irfft(spectrum, points, axis=0)).max(axis=0))

    @public_call
    def __call__(self, t: ArrayLike) -> FloatArray:
        """Return the joint torques (joints,) at a time (s), or (T, joints) at times (T,); N m."""
        times = check_times("t", t)
        values = self._steady(times.ravel())
        if self.rise:
            part = np.clip(times.ravel() / self.rise, 0.0, 1.0)
            values = values * np.sin(0.5 * np.pi * part)[:, None] ** 2
        return values.reshape(*times.shape, self.joints)

    @public_call
    def samples(self, rate: Positive, duration: Positive) -> FloatArray:
        """Return samples (samples, joints) from time 0 to ``duration`` (s) at ``rate`` (Hz), N m.

        They are for the output of a controller, or for ``simulate`` with the same ``rate``.

        Raises:
            InputError: if the rate is not above twice the highest frequency, or a number is not
                positive.
        """
        highest = float(self.frequency_hz.max())
        if rate <= 2.0 * highest:
            raise InputError(Problem("rate", f"be greater than {2.0 * highest:g} Hz", shown(rate)))
        if (fault := sample_fault(duration, rate)) is not None:
            raise InputError(fault.problem())
        return self(np.arange(int(duration * rate * (1.0 + 1e-12)) + 1) / rate)

    def _steady(self, times: FloatArray) -> FloatArray:
        """Return the torques (T, joints) without the rise."""
        values = np.empty((times.size, self.joints))
        block = max(1, _TOGETHER // self.harmonics.size)
        for first in range(0, times.size, block):
            part = slice(first, first + block)
            turns = np.outer(np.mod(times[part] / self.period, 1.0), self.harmonics)
            values[part] = (np.exp(2j * np.pi * turns) @ self.coefficients).real
        return values

    @public_call
    def scaled(self, factor: ArrayLike) -> Multisine:
        """Return the multisine times a number, or one number for each joint."""
        factors = np.broadcast_to(check_each("factor", factor, self.joints), (self.joints,))
        return replace(self, coefficients=self.coefficients * factors)

    @public_call
    def orthogonal(self) -> list[Multisine]:
        """Return as many multisines as there are joints, for one experiment each.

        Together they distinguish the effects of the joints at every frequency: joint j of
        experiment e has the phase 2 pi e j / joints in addition. The peaks of different experiments
        differ a little.
        """
        n = self.joints
        turned = np.exp(2j * np.pi * np.outer(np.arange(n), np.arange(n)) / n)
        return [replace(self, coefficients=self.coefficients * row) for row in turned]


def rates_of(torque: Multisine, times: FloatArray) -> FloatArray:
    """Return the derivatives (T, joints) of the torques at times (T,), N m/s."""
    turned = 2j * np.pi * torque.frequency_hz[:, None] * torque.coefficients
    rates = replace(torque, coefficients=turned)(times)
    if torque.rise:
        part = np.clip(times / torque.rise, 0.0, 1.0)
        slope = 0.5 * np.pi / torque.rise * np.sin(np.pi * part)
        rates += slope[:, None] * replace(torque, rise=0.0)(times)
    return rates


def schroeder(count: int) -> NDArray[np.complex128]:
    """Return complex numbers (count,) of size one with Schroeder phases, for a low peak."""
    place = np.arange(count)
    return np.asarray(np.exp(-1j * np.pi * place * (place + 1.0) / count))


@public_call
def multisine(
    period: Positive,
    band: ArrayLike,
    peak: ArrayLike,
    *,
    joints: Count = 1,
    rise: NonNegative = 0.0,
) -> Multisine:
    """Create a multisine with equal amplitudes and Schroeder phases in a band of frequencies.

    The phases keep the peak low compared with the power. The frequencies are all multiples of one
    over the period in the band.

    Args:
        period: s: one over the resolution in Hz.
        band: lowest and highest frequency, Hz.
        peak: largest torque within a period, N m: a number, or one for each joint.
        joints: number of joints, if ``peak`` is one number.
        rise: s, during which the amplitude grows smoothly from zero.

    Returns:
        A torque for ``simulate``.

    Raises:
        InputError: if an argument is not positive, or no multiple is in the band.
    """
    low, high = check_array("band", band, (2,)).tolist()
    first = max(1, int(np.ceil(min(low * period * (1.0 - 1e-9), 1e15))))
    last = int(np.floor(min(high * period * (1.0 + 1e-9), 1e15)))
    if not first <= last <= _HIGHEST:
        rule = f"contain multiples of 1/period, {1.0 / period:.6g} Hz, the highest one {_HIGHEST}"
        raise InputError(Problem("band", rule, shown([low, high])))
    peaks = check_each("peak", peak, positive=True)
    count = peaks.size if peaks.ndim else joints
    harmonics = np.arange(first, last + 1)
    lines = np.repeat(schroeder(harmonics.size)[:, None], count, axis=1)
    found = Multisine(period, harmonics, lines, rise)
    return found.scaled(np.broadcast_to(peaks, (count,)) / found.peak)
