"""Structured singular values, and D-K iteration with them: theory page "control-robust"."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexarm.base.arguments import library_missing
from flexarm.base.errors import InputError, Problem
from flexarm.base.late import linalg, optimize
from flexarm.control.analysis.sampled_loop import ComplexArray, Response
from flexarm.control.design.loop_shaping import Matrices, in_series
from flexarm.control.hardware.measurement import FloatArray

#: Lower and upper end.
Interval = tuple[float, float]

#: Iterations of the balancing. Each reduces the remaining error of typical matrices by a half.
_BALANCES = 40
#: Smallest norm of a block, relative to that of the matrix, so that logarithms are finite.
_TINY = 1e-12


def structured_bound(matrices: ComplexArray, blocks: Sequence[int]) -> FloatArray:
    """Return upper bounds (f,) of the structured singular values of matrices (f, n, n).

    The uncertainty is block-diagonal with full complex blocks. Scalings are balanced by Osborne's
    iteration for all matrices. They are optimised further until the largest bound is optimal, so
    that the maximum is accurate and other bounds may be a few percent too large. For up to three
    blocks the optimal bound is the structured singular value (Packard and Doyle 1993); (C.148).
    """
    return structured_scales(matrices, blocks)[0]


def structured_scales(
    matrices: ComplexArray, blocks: Sequence[int]
) -> tuple[FloatArray, FloatArray]:
    """Return the bounds of `structured_bound`, and logarithms (f, blocks) of balanced scalings."""
    logs = _balanced(matrices, blocks)
    bounds, plain = (scaled_norms(matrices, blocks, each) for each in (logs, 0.0 * logs))
    logs[plain < bounds] = 0.0  # balancing may increase the norm, which it does not minimise
    bounds = np.minimum(bounds, plain)
    done: set[int] = set()
    while (k := int(np.argmax(bounds))) not in done:
        done.add(k)
        bounds[k] = _refined(matrices[k], blocks, logs[k])
    return bounds, logs


def scaled_norms(matrices: ComplexArray, blocks: Sequence[int], logs: FloatArray) -> FloatArray:
    """Return the largest singular values (f,) of scaled matrices; ``logs`` (f, blocks)."""
    scale = np.exp(np.repeat(logs, blocks, axis=1))
    scaled = scale[:, :, None] * matrices / scale[:, None, :]
    return np.asarray(np.linalg.svd(scaled, compute_uv=False)[:, 0], dtype=np.float64)


def _balanced(matrices: ComplexArray, blocks: Sequence[int]) -> FloatArray:
    """Return logarithms (f, blocks) of scalings that minimise the Frobenius norms."""
    logs = np.zeros((len(matrices), len(blocks)))
    if len(blocks) == 1:
        return logs
    starts = np.cumsum([0, *blocks[:-1]])
    square = np.abs(matrices) ** 2
    square = np.add.reduceat(np.add.reduceat(square, starts, axis=1), starts, axis=2)
    total = square.sum(axis=(1, 2), keepdims=True)
    square = np.maximum(square, _TINY**2 * total + np.finfo(float).tiny)
    # Scalings do not change the diagonal. Subtracting it from the sums would cancel digits.
    square[:, range(len(blocks)), range(len(blocks))] = 0.0
    for _ in range(_BALANCES):
        for i in range(1, len(blocks)):
            scale = np.exp(2.0 * logs)
            row = (square[:, i] / scale).sum(axis=1)
            column = (square[:, :, i] * scale).sum(axis=1)
            logs[:, i] = 0.25 * np.log(column / row)
    return logs


def _refined(matrix: ComplexArray, blocks: Sequence[int], start: FloatArray) -> float:
    """Return the smallest norm over scalings, which is convex in their logarithms."""
    if len(blocks) == 1:
        return float(scaled_norms(matrix[None], blocks, np.zeros((1, 1)))[0])

    def norm(free: FloatArray) -> float:
        return float(scaled_norms(matrix[None], blocks, np.append(0.0, free)[None])[0])

    # The norm is not differentiable where singular values are equal, as they often are at the
    # minimum: use a method without derivatives.
    options = {"xatol": 1e-5, "fatol": 1e-9, "maxiter": 400 * len(blocks)}
    found = optimize.minimize(norm, start[1:] - start[0], method="Nelder-Mead", options=options)
    return float(found.fun)


#: Relative accuracy of the least norm. The norm of the controller is larger by ``suboptimality``.
_ACCURACY = 1e-3
#: Norm from which the search for the least norm starts.
_LARGEST = 1e4
#: Further ratios to the least norm, and largest ratio of the norm to the reported one.
_FURTHER, _TRUSTED = (1.1, 1.3), 1.02
#: Largest condition number of the block-diagonal coordinates.
_CONDITION = 1e4
#: Evaluations of the peak for each number of the scalings.
_EVALUATIONS = 100
#: Power of the norms in the mean that the scalings minimise: a high peak counts most, but norms at
#: other frequencies are reduced, too, which gives the next synthesis its freedom.
_POWER = 16
#: The least-squares fit of the scalings is for frequencies near the peak of mu: power of mu.
_NEAR_PEAK = 4


class RobustController(NamedTuple):
    """Continuous controller u = K v for positive feedback, and its bounds."""

    A: FloatArray  # state-space matrices
    B: FloatArray  # state-space matrices
    C: FloatArray  # state-space matrices
    D: FloatArray  # state-space matrices
    mu: float  # largest upper bound of the structured singular value at the frequencies
    gamma: float  # H-infinity norm that the synthesis of this controller was given as a bound
    history: tuple[float, ...]  # largest upper bound of mu after each iteration


def dk_iteration(
    plant: Matrices,
    blocks: Sequence[int],
    omega: FloatArray,
    iterations: int,
    order: int,
    band: Interval,
    suboptimality: float,
    start: Matrices | None = None,
) -> RobustController:
    """Return a controller that minimises the structured singular value of a loop; (C.152).

    H-infinity synthesis for fixed scalings and the fit of scalings for a fixed controller alternate
    (Skogestad and Postlethwaite 2005, section 8.12). The result is the best iterate.

    Args:
        plant: A, B, C, D, continuous, from (w, u) to (z, v). Inputs w and outputs z have the sizes
            of the blocks of the uncertainty, the last of which is that of the performance.
        blocks: sizes of the blocks, full and complex.
        omega: (f,) rad/s, frequencies of the bounds and of the fit.
        iterations: number of syntheses.
        order: largest order of a scaling, 0 to 2.
        band: interval of the zeros and poles of the scalings, rad/s.
        suboptimality: ratio of the norm of a synthesis to the least norm, above 1.
        start: controller of the first scalings; None for scalings of one.
    """
    size = sum(blocks)
    scalings: list[FloatArray] = [np.zeros(1)] * (len(blocks) - 1)
    loop = None if start is None else closed_loop(plant, size, start, omega)
    best: RobustController | None = None
    history: list[float] = []
    for _ in range(iterations):
        if loop is not None:
            scalings = _fitted(loop, blocks, omega, order, band)
        try:
            K, gamma = _synthesis(_scaled(plant, scalings, blocks), size, omega, suboptimality)
        except ArithmeticError as error:
            if best is None:
                hint = "Reduce the bandwidth, the uncertainty or the number of elements."
                reason = " ".join(str(error).split())[:120].rstrip(".")
                rule = f"does not permit an H-infinity synthesis: {reason}"
                raise InputError(Problem("arm", rule, hint=hint)) from None
            break
        loop = closed_loop(plant, size, K, omega)
        bounds, _ = structured_scales(loop, blocks)
        history.append(float(bounds.max()))
        if best is None or history[-1] < best.mu:
            best = RobustController(*K, history[-1], gamma, ())
    assert best is not None
    return best._replace(history=tuple(history))


def closed_loop(plant: Matrices, size: int, K: Matrices, omega: FloatArray) -> ComplexArray:
    """Return the response (f, size, size) of a plant with the controller u = K v; from w to z."""
    P, k = (Response(A, B, C)(1j * omega) + D for A, B, C, D in (plant, K))
    inner = np.linalg.solve(np.eye(P.shape[1] - size) - P[:, size:, size:] @ k, P[:, size:, :size])
    return np.asarray(P[:, :size, :size] + P[:, :size, size:] @ k @ inner)


def _synthesis(
    plant: Matrices, size: int, omega: FloatArray, suboptimality: float
) -> tuple[Matrices, float]:
    """Return an H-infinity controller and the bound on its norm, by SB10AD of SLICOT."""
    try:
        from slycot import sb10ad
        from slycot.exceptions import SlycotError
    except ImportError:
        raise library_missing("slycot", "robust") from None
    reason = "rounding errors of SLICOT are too large for this model"
    valid: list[tuple[float, Matrices]] = []
    for A, B, C, D in (_in_balanced_coordinates(plant), plant):
        sizes = len(A), B.shape[1], len(C), B.shape[1] - size, len(C) - size
        try:
            least = float(sb10ad(*sizes, _LARGEST, A, B, C, D, job=1, gtol=_ACCURACY)[0])
        except SlycotError as error:
            reason = " ".join(str(error).split())
            continue
        for factor in (suboptimality, *_FURTHER):
            try:
                found = sb10ad(*sizes, factor * least, A, B, C, D, job=4)
            except SlycotError:
                continue
            K: Matrices = tuple(found[1:5])
            norm = np.linalg.norm(closed_loop(plant, size, K, omega), 2, axis=(1, 2)).max()
            if norm < _TRUSTED * factor * least and np.linalg.eigvals(found[5]).real.max() < 0.0:
                valid.append((factor * least, K))
                break
    if not valid:
        raise ArithmeticError(reason)
    gamma, K = min(valid, key=lambda one: one[0])
    return K, gamma


def _in_balanced_coordinates(plant: Matrices) -> Matrices:
    """Return a model in block-diagonal, balanced coordinates.

    In the coordinates of an arm, the Riccati equations of SB10AD have no correct digits: the norm
    of the loop may be ten times the reported one.
    """
    from control import bdschur
    from slycot import tb01id

    A, B, C, D = plant
    A, basis, _ = bdschur(A, condmax=_CONDITION)
    B, C = np.linalg.solve(basis, B), C @ basis
    _, A, B, C, _ = tb01id(len(A), B.shape[1], len(C), 10.0, A, B, C, "A")
    return A, B, C, D


def _fitted(
    loop: ComplexArray, blocks: Sequence[int], omega: FloatArray, order: int, band: Interval
) -> list[FloatArray]:
    """Return scalings, as logarithms, see `_magnitude`.

    Scalings of a higher order replace those of a lower order if they reduce the mean by 0.2 %.
    """
    count = len(blocks) - 1
    bounds, logs = structured_scales(loop, blocks)
    wanted = logs[:, :-1] - logs[:, -1:]
    share = (bounds / bounds.max()) ** _NEAR_PEAK
    low, high = np.log(band)
    middle = float(np.clip(np.average(np.log(omega), weights=share), low + 1.1, high - 1.1))
    best, least = np.zeros((count, 1)), np.inf
    for each in range(order + 1 if count else 0):
        limits = [(-40.0, 40.0), *[(low, high)] * (2 * each)]

        def peak(x: FloatArray, each: int = each) -> float:
            numbers = x.reshape(count, 1 + 2 * each)
            scale = np.array([_magnitude(one, omega) for one in numbers]).T
            whole = np.column_stack([scale, np.zeros(len(omega))])
            norms = scaled_norms(loop, blocks, whole)
            return float(np.mean(norms**_POWER) ** (1.0 / _POWER))

        starts = [np.hstack([best, np.full((count, 1 + 2 * each - best.shape[1]), middle)]).ravel()]
        fits = []
        for k in range(count):

            def missed(x: FloatArray, k: int = k) -> FloatArray:
                return np.asarray((_magnitude(x, omega) - wanted[:, k]) * share)

            first = [np.average(wanted[:, k], weights=share)]
            corners = middle + np.linspace(-1.0, 1.0, 2 * each)
            box: Any = tuple(zip(*limits, strict=True))
            fits.append(optimize.least_squares(missed, [*first, *corners], bounds=box).x)
        starts.append(np.concatenate(fits))
        options = {"maxfev": _EVALUATIONS * starts[0].size, "xatol": 1e-3, "fatol": 1e-4}
        begin = min(starts, key=peak)
        done = optimize.minimize(
            peak, begin, method="Nelder-Mead", bounds=limits * count, options=options
        )
        if done.fun < 0.998 * least:
            best, least = done.x.reshape(count, -1), float(done.fun)
    return list(best)


def _magnitude(numbers: FloatArray, omega: FloatArray) -> FloatArray:
    """Return log|D| (f,) of D = exp(g) prod (1 + s / zero) / (1 + s / pole)."""
    found = np.full(len(omega), numbers[0])
    for zero, pole in numbers[1:].reshape(-1, 2):
        found += 0.5 * np.log1p((omega * np.exp(-zero)) ** 2)
        found -= 0.5 * np.log1p((omega * np.exp(-pole)) ** 2)
    return found


def _scaled(plant: Matrices, scalings: Sequence[FloatArray], blocks: Sequence[int]) -> Matrices:
    """Return the plant with D at z and the inverse at w, both stable."""
    _, B, C, _ = plant
    ahead = _diagonal(scalings, blocks, B.shape[1], inverted=True)
    behind = _diagonal(scalings, blocks, len(C), inverted=False)
    return in_series(behind, in_series(plant, ahead))


def _diagonal(
    scalings: Sequence[FloatArray], blocks: Sequence[int], width: int, *, inverted: bool
) -> Matrices:
    """Return the scalings as a model with ``width`` inputs; those after the blocks are one."""
    parts = []
    for numbers, size in zip(scalings, blocks, strict=False):
        one = _realised(-numbers[0] if inverted else numbers[0], numbers[1:], inverted)
        parts.append([np.kron(np.eye(size), part) for part in one])
    rest = width - sum(part[3].shape[1] for part in parts)
    parts.append([np.zeros((0, 0)), np.zeros((0, rest)), np.zeros((rest, 0)), np.eye(rest)])
    A, B, C, D = (linalg.block_diag(*place) for place in zip(*parts, strict=True))
    return A, B, C, D


def _realised(gain: float, numbers: FloatArray, inverted: bool) -> Matrices:
    """Return exp(gain) prod (1 + s / zero) / (1 + s / pole), with zeros and poles exchanged."""
    none = np.zeros((0, 0))
    found: Matrices = none, np.zeros((0, 1)), np.zeros((1, 0)), np.array([[np.exp(gain)]])
    for pair in np.exp(numbers).reshape(-1, 2):
        zero, pole = pair[::-1] if inverted else pair
        through = pole / zero
        one = np.array([[-pole]]), np.array([[pole]]), np.array([[1.0 - through]])
        found = in_series((*one, np.array([[through]])), found)
    return found
