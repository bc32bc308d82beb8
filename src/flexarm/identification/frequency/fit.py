"""Modes of vibration that fit frequency responses: a rational form with common poles.

H(s) = sum_k [A_k / (s - p_k) + conj(A_k) / (s - conj(p_k))] + R / (s (s + a)) + sum_n R_n s^n, n
from -2 to 2, times s for rates. The rigid arm, whose dampers give the pole -a, has the negative
powers; the others are modes above the band. The residues A_k and the real numbers R are linear;
they are eliminated, and the poles are found by nonlinear least squares (variable projection: Golub
and Pereyra, SIAM Journal on Numerical Analysis 10 (1973) 413). The first poles are those that
reduce the errors most, one after another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, ClassVar

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from flexarm.base.arguments import check_kind
from flexarm.base.errors import InputError, Problem, few, public_call
from flexarm.base.notebook import html_table
from flexarm.identification.record import Label, place_of
from flexarm.integrate.base import FloatArray
from flexarm.linear import Modes, linearize

ComplexArray = NDArray[np.complex128]
#: Smallest deviation that is used, as a fraction of the response and of its largest magnitude:
#: instruments are not more accurate, and measured deviations scatter.
_LEAST, _LEAST_OF_ALL = 1e-3, 1e-6
#: Damping ratios of trial poles, and number of their frequencies.
_TRIALS, _PLACES = (0.003, 0.02, 0.1), 200
#: Change of the numbers for derivatives of the errors.
_STEP = 1e-5
#: Relative changes that end the search for poles: while modes are missing, and at the end.
_COARSE, _FINE = 1e-3, 1e-12
#: Powers of s, terms beside the modes, and the largest damping ratio of a mode.
_POWERS, _OTHERS = range(-2, 3), 6
_DAMPED = 0.5
#: Relative differences of frequency and damping ratio of a stable mode from one order to the next.
_SAME_FREQUENCY, _SAME_DAMPING = 0.01, 0.1


def _share(value: FloatArray) -> FloatArray:
    """Return a number between 0 and 1."""
    from scipy.special import expit

    return np.asarray(expit(value))


class ModeProblem:
    """Weighted errors of responses as functions of poles, without the linear numbers.

    The numbers are the logarithm of the rigid pole a (rad/s) and, for each mode, the logarithm of
    its natural frequency (rad/s) and the logit of its damping ratio over the largest one. All of
    them are stable poles. ``values`` (rows, responses) are weighted, ``limits`` are the logarithms
    of the lowest and the highest frequency.
    """

    values: FloatArray
    limits: tuple[float, float]

    def terms_of_pole(self, pole: FloatArray) -> list[FloatArray]:
        """Return the weighted terms (rows, n) of a mode with numbers (2,) for each response."""
        raise NotImplementedError

    def other_terms(self, rigid: float) -> list[FloatArray]:
        """Return the other weighted terms (rows, n) for each response."""
        raise NotImplementedError

    def residues(self, numbers: FloatArray) -> tuple[ComplexArray, NDArray[Any]]:
        """Return residues (k, outputs, inputs), and what the fit predicts."""
        raise NotImplementedError

    def reweight(self, numbers: FloatArray) -> None:
        """Adapt the weights to the errors that remain."""

    def trial_frequencies(self, errors: Sequence[FloatArray]) -> FloatArray:
        """Return logarithms of frequencies at which a mode may reduce the errors."""
        return np.linspace(*self.limits, _PLACES)

    @property
    def start(self) -> FloatArray:
        """The numbers (1,) without modes: a rigid pole below the band."""
        return np.array([np.log(0.1) + self.limits[0]])

    def matrices(self, numbers: FloatArray) -> list[FloatArray]:
        """Return the weighted terms (rows, n) whose real factors are linear in the model."""
        parts = [self.other_terms(numbers[0]), *map(self.terms_of_pole, numbers[1:].reshape(-1, 2))]
        return [np.hstack(columns) for columns in zip(*parts, strict=True)]

    def linear(self, matrix: FloatArray, response: int) -> FloatArray:
        """Return the linear numbers of a response."""
        return np.asarray(np.linalg.lstsq(matrix, self.values[:, response], rcond=None)[0])

    def _rest(self, bases: list[FloatArray]) -> list[FloatArray]:
        return [v - b @ (b.T @ v) for v, b in zip(self.values.T, bases, strict=True)]

    def errors(self, numbers: FloatArray) -> FloatArray:
        """Return the weighted errors that remain for the best linear numbers."""
        return np.concatenate(self._rest([np.linalg.qr(m)[0] for m in self.matrices(numbers)]))

    def next_pole(self, numbers: FloatArray) -> FloatArray:
        """Return the numbers (2,) of the trial pole that reduces the errors most."""
        bases = [np.linalg.qr(matrix)[0] for matrix in self.matrices(numbers)]
        errors = self._rest(bases)
        logits = [np.log(zeta / (_DAMPED - zeta)) for zeta in _TRIALS]
        best, chosen = -1.0, np.zeros(2)
        for trial in product(self.trial_frequencies(errors), logits):
            gain = 0.0
            for basis, rest, terms in zip(
                bases, errors, self.terms_of_pole(np.array(trial)), strict=True
            ):
                # Of the terms only the part that is orthogonal to the basis counts.
                beyond = np.linalg.qr(terms - basis @ (basis.T @ terms))[0]
                gain += float(np.sum((beyond.T @ rest) ** 2))
            if gain > best:
                best, chosen = gain, np.array(trial)
        return chosen

    def slopes(self, numbers: FloatArray) -> FloatArray:
        """Return derivatives (errors, numbers) of the errors; Kaufman, BIT 15 (1975) 49."""
        matrices = self.matrices(numbers)
        factors = [self.linear(matrix, q) for q, matrix in enumerate(matrices)]
        columns = []
        for change in _STEP * np.eye(numbers.size):
            pairs = zip(
                self.matrices(numbers + change), self.matrices(numbers - change), strict=True
            )
            columns.append(
                [(a - b) @ f / (2.0 * _STEP) for (a, b), f in zip(pairs, factors, strict=True)]
            )
        blocks = []
        for q, matrix in enumerate(matrices):
            basis = np.linalg.qr(matrix)[0]
            moved = np.stack([each[q] for each in columns], axis=1)
            blocks.append(basis @ (basis.T @ moved) - moved)
        return np.concatenate(blocks)

    def refined(self, numbers: FloatArray, precision: float) -> FloatArray:
        """Return the numbers with the least errors near the given ones."""
        from scipy.optimize import least_squares

        low, high = self.limits
        count = numbers.size // 2
        lower = np.array([low - 7.0, *(count * [low - 0.5, -12.0])])
        upper = np.array([low + 2.0, *(count * [high + 0.5, 12.0])])
        fit = least_squares(
            self.errors,
            np.clip(numbers, lower + 1e-6, upper - 1e-6),
            jac=self.slopes,
            bounds=(lower, upper),
            x_scale="jac",
            xtol=precision,
            ftol=precision,
            max_nfev=100,
        )
        return np.asarray(fit.x)

    def deviations(self, numbers: FloatArray) -> FloatArray:
        """Return standard deviations (k, 2); larger errors than the noise increase them."""
        slopes, errors = self.slopes(numbers), self.errors(numbers)
        linear = sum(matrix.shape[1] for matrix in self.matrices(numbers))
        excess = max(1.0, float(errors @ errors) / max(1, errors.size - numbers.size - linear))
        covariance = np.linalg.pinv(slopes.T @ slopes, rcond=1e-12, hermitian=True) * excess
        return np.sqrt(np.maximum(np.diag(covariance)[1:], 0.0)).reshape(-1, 2)


def fitted_modes(problem: ModeProblem, count: int) -> dict[str, Any]:
    """Fit 1 to ``count`` modes; return the arrays of `MeasuredModes`, sorted by frequency."""
    numbers, each = problem.start, []
    for number in range(1, count + 1):
        numbers = np.concatenate([numbers, problem.next_pole(numbers)])
        numbers = problem.refined(numbers, _FINE if number == count else _COARSE)
        problem.reweight(numbers)
        each.append(root_of(numbers[1:].reshape(-1, 2)))
    poles = numbers[1:].reshape(-1, 2)
    order = np.argsort(poles[:, 0])
    numbers = np.concatenate([numbers[:1], poles[order].ravel()])
    deviations = problem.deviations(numbers)
    hertz, share = np.exp(poles[order, 0]) / (2.0 * np.pi), _share(poles[order, 1])
    residues, predicted = problem.residues(numbers)
    return {
        "residues": residues,
        "fitted": predicted,
        "frequency_hz": hertz,
        "damping_ratio": _DAMPED * share,
        "frequency_deviation": hertz * deviations[:, 0],
        "damping_deviation": _DAMPED * share * (1.0 - share) * deviations[:, 1],
        "orders": _diagram(each),
    }


def root_of(poles: FloatArray) -> ComplexArray:
    """Return the roots (k,) with positive imaginary part of numbers (k, 2) of poles, 1/s."""
    return _roots(np.exp(poles[:, 0]), _DAMPED * _share(poles[:, 1]))


def _roots(omega: FloatArray, zeta: FloatArray) -> ComplexArray:
    return np.asarray(omega * (-zeta + 1j * np.sqrt(1.0 - zeta**2)))


def _diagram(each: list[ComplexArray]) -> xr.Dataset:
    """Return the order diagram of the roots that were fitted with 1, 2, ... modes."""
    size = len(each)
    roots = np.full((size, size), np.nan, dtype=np.complex128)
    for k, order_roots in enumerate(each):
        roots[k, : k + 1] = order_roots[np.argsort(np.abs(order_roots))]
    omega, damping = np.abs(roots), -roots.real / np.abs(roots)
    near = [
        np.abs(values[1:, :, None] / values[:-1, None, :] - 1.0) < limit
        for values, limit in ((omega, _SAME_FREQUENCY), (damping, _SAME_DAMPING))
    ]
    stable = np.vstack([np.zeros((1, size), dtype=bool), (near[0] & near[1]).any(axis=2)])
    columns = {"frequency_hz": omega / (2.0 * np.pi), "damping_ratio": damping, "stable": stable}
    numbers = np.arange(1, size + 1)
    return xr.Dataset(
        {name: (("order", "mode"), values) for name, values in columns.items()},
        {"order": numbers, "mode": numbers},
    )


class RationalProblem(ModeProblem):
    """Weighted errors of a response (F, outputs, inputs) at frequencies (F,) Hz.

    ``deviation`` is that of the response, NaN where unknown; ``rates`` (outputs,) states whether an
    output is the rate of a position.
    """

    def __init__(
        self,
        hertz: FloatArray,
        response: ComplexArray,
        deviation: FloatArray,
        rates: NDArray[np.bool_],
    ) -> None:
        self._s = 2j * np.pi * hertz
        self.limits = (float(np.log(abs(self._s[0]))), float(np.log(abs(self._s[-1]))))
        self._shape = response.shape
        size = np.abs(response)
        least = _LEAST * size + _LEAST_OF_ALL * size.max(axis=0)
        spread = np.where(np.isnan(deviation), least, np.maximum(deviation, least))
        # Half the variance of a complex number is that of its real part.
        weight = np.sqrt(2.0) / np.where(spread > 0.0, spread, 1.0)
        rate = np.where(np.repeat(rates, response.shape[2]), self._s[:, None], 1.0)
        self._weight = weight.reshape(len(hertz), -1)
        self._factors = list((self._weight * rate).T)
        self.values = _parts(self._weight * response.reshape(len(hertz), -1))

    def _weighted(self, terms: ComplexArray) -> list[FloatArray]:
        return [_parts(factor[:, None] * terms) for factor in self._factors]

    def other_terms(self, rigid: float) -> list[FloatArray]:
        s = self._s
        middle = np.sqrt(np.abs(s[0] * s[-1]))
        columns = [(s / middle) ** power for power in _POWERS]
        columns.append(middle**2 / (s * (s + np.exp(rigid))))
        return self._weighted(np.stack(columns, axis=1))

    def terms_of_pole(self, pole: FloatArray) -> list[FloatArray]:
        omega, zeta = np.exp(pole[0]), _DAMPED * _share(pole[1])
        below = self._s**2 + 2.0 * zeta * omega * self._s + omega**2
        return self._weighted(np.stack([omega**2 / below, omega * self._s / below], axis=1))

    def residues(self, numbers: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        poles = numbers[1:].reshape(-1, 2)
        omega, root = np.exp(poles[:, 0]), root_of(poles)
        residues, response = [], []
        for q, (matrix, factor) in enumerate(
            zip(self.matrices(numbers), self._factors, strict=True)
        ):
            linear = self.linear(matrix, q)
            real, imaginary = np.split(matrix @ linear, 2)
            response.append((real + 1j * imaginary) / self._weight[:, q])
            even, odd = linear[_OTHERS::2] * omega**2, linear[_OTHERS + 1 :: 2] * omega
            residue = (even + odd * root) / (2j * root.imag)
            rate = np.any(factor.imag)
            residues.append(residue * (root if rate else 1.0))
        shape = self._shape[1:]
        every = np.stack(residues, axis=1).reshape(-1, *shape)
        return every, np.stack(response, axis=1).reshape(-1, *shape)


def _parts(values: ComplexArray) -> FloatArray:
    """Return real and imaginary parts, one after the other along the first axis."""
    return np.concatenate([values.real, values.imag])


#: Motion of an output, relative to the RMS of its channel, that is rounding.
_STILL = 1e-9


@dataclass(frozen=True, eq=False)
class MeasuredModes:
    """Modes that were fitted to measurements, in the order of ascending frequency.

    They are fitted to a `FrequencyResponse`, or to records over time by `measured_modes`.

    Attributes:
        frequency_hz: (k,) natural frequencies, the moduli of the poles over 2 pi.
        damping_ratio: (k,)
        frequency_deviation, damping_deviation: (k,) standard deviations, from the deviation of the
            response and, if larger, the errors of the fit; as in `identify` for records.
        residues: (k, outputs, inputs) complex numbers A of the terms A / (s - p) of the response.
        fitted: (F, outputs, inputs) response of the fit at the frequencies in the band; for
            records, the outputs (samples, outputs) of all of them, one after another, also in gaps.
        fit: (outputs, inputs) percent, 100 is perfect; (outputs,) for records.
        orders: order diagram over ``order``, the number of modes that were fitted, and ``mode``:
            ``frequency_hz``, ``damping_ratio``, and ``stable``, whether they differ by less than
            1 % and 10 % from those of a mode of the order before. Modes that noise imitates are
            not stable.
        outputs, inputs: names, as in the response or the records.
    """

    frequency_hz: FloatArray
    damping_ratio: FloatArray
    frequency_deviation: FloatArray
    damping_deviation: FloatArray
    residues: NDArray[np.complex128]
    fitted: NDArray[Any] = field(repr=False)
    fit: FloatArray
    orders: xr.Dataset = field(repr=False)
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    _labels: tuple[Label, ...] = field(repr=False)
    references: ClassVar[str] = "AllemangBrown1982"

    def __repr__(self) -> str:
        frequencies = few(self.frequency_hz)
        return f"<flexarm.MeasuredModes: {self.frequency_hz.size}: {frequencies} Hz>"

    def _repr_html_(self) -> str:
        heads = ("mode", "frequency (Hz)", "std. deviation", "damping ratio", "std. deviation")
        columns = (
            self.frequency_hz,
            self.frequency_deviation,
            self.damping_ratio,
            self.damping_deviation,
        )
        rows = zip(range(1, self.frequency_hz.size + 1), *columns, strict=True)
        return html_table(repr(self).strip("<>"), heads, rows)

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Poles (k,) with positive imaginary part, 1/s."""
        return _roots(2.0 * np.pi * self.frequency_hz, self.damping_ratio)

    @property
    def shapes(self) -> NDArray[np.complex128]:
        """Shapes (k, outputs), in output units of the residue of the input with the largest effect.

        With several inputs, the shapes that fit the residues of all of them best.
        """
        left, size, right = np.linalg.svd(self.residues)
        turned = left[:, :, 0] * size[:, :1]
        largest = np.argmax(np.abs(right[:, 0]), axis=1)
        phase = np.take_along_axis(right[:, 0], largest[:, None], axis=1)
        return np.asarray(turned * phase / np.abs(phase))

    @public_call
    def compare(self, modes: Modes) -> xr.Dataset:
        """Compare with the modes of a model by the modal assurance criterion.

        Args:
            modes: those of the model in the posture of the experiment, with ``joints="free"`` if
                torques were the inputs. Only those that oscillate are compared.

        Returns:
            Dataset over ``measured`` and ``model`` (numbers of modes from 1): ``mac``, from 0 to 1
            for equal shapes; over ``measured``: ``match``, the mode of the model with the largest
            ``mac``, and ``frequency_error`` and ``damping_error`` (percent), model minus measured.

        Raises:
            InputError: if the arm does not have the outputs, there is only one, no mode of the
                model oscillates, or these modes do not move the outputs.

        Outputs are divided by the RMS of their channel in the modes of the model, one number for
        all joints, gauges or axes of a channel: outputs of equal units keep their ratios. Allemang
        and Brown, Proceedings of the 1st International Modal Analysis Conference, 1982, p. 110.
        """
        modes = check_kind("modes", modes, Modes)
        if len(self.outputs) < 2:
            rule = "requires at least two outputs: with one, all shapes are equal"
            raise InputError(Problem("compare", rule))
        vibrating = np.flatnonzero(modes.eigenvalues.imag > 0.0)
        if not vibrating.size:
            raise InputError(Problem("modes", "contain no mode that oscillates"))
        own, sizes = _shapes_at(modes, vibrating, self._labels)
        if not np.any(np.abs(own) > _STILL * sizes):
            raise InputError(Problem("modes", "do not move any of the outputs"))
        weight = np.where(sizes > 0.0, 1.0 / np.where(sizes > 0.0, sizes, 1.0), 0.0)
        mac = assurance(self.shapes * weight, own * weight)
        match = np.argmax(mac, axis=1)
        eigenvalues = modes.eigenvalues[vibrating][match]
        hertz = np.abs(eigenvalues) / (2.0 * np.pi)
        damping = -eigenvalues.real / np.abs(eigenvalues)
        errors = {
            "frequency_error": 100.0 * (hertz / self.frequency_hz - 1.0),
            "damping_error": 100.0 * (damping / self.damping_ratio - 1.0),
        }
        percent = {"units": "%", "long_name": "model minus measured, relative"}
        return xr.Dataset(
            {
                "mac": (("measured", "model"), mac, {"long_name": "modal assurance criterion"}),
                "match": ("measured", vibrating[match] + 1, {"long_name": "mode of the model"}),
                **{name: ("measured", values, percent) for name, values in errors.items()},
            },
            {"measured": np.arange(1, len(mac) + 1), "model": vibrating + 1},
        )


def _shapes_at(
    modes: Modes, numbers: NDArray[np.intp], labels: tuple[Label, ...]
) -> tuple[NDArray[np.complex128], FloatArray]:
    """Return shapes (k, outputs) of modes of a model, and the RMS (outputs,) of their channels."""
    # The RMS is over the modes and all parts of a channel, because a part that does not move, such
    # as the axis along the arm, has no size of its own.
    states = np.concatenate(
        [modes.complex_shapes, modes.eigenvalues[:, None] * modes.complex_shapes], axis=1
    )[numbers]
    places = [place_of(modes.arm, label) for label in labels]
    parts = {
        name: states @ linearize(modes.arm, modes.q, outputs=[name]).C.T
        for name in dict.fromkeys(label.channel for label in labels)
    }
    own = [parts[label.channel][:, place] for label, place in zip(labels, places, strict=True)]
    sizes = [np.sqrt(np.mean(np.abs(parts[label.channel]) ** 2)) for label in labels]
    return np.stack(own, axis=1), np.array(sizes)


def assurance(first: NDArray[np.complex128], second: NDArray[np.complex128]) -> FloatArray:
    """Return the modal assurance criterion (k, l) of shapes (k, n) and (l, n)."""
    sizes = np.outer(np.sum(np.abs(first) ** 2, axis=1), np.sum(np.abs(second) ** 2, axis=1))
    return np.asarray(np.abs(first.conj() @ second.T) ** 2 / np.where(sizes > 0.0, sizes, 1.0))
