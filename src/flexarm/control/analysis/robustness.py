"""Robust stability and performance of a sampled loop for the plants around a sample."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning, warn_of_first
from flexarm.base.arguments import check_kind, check_number
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.control.analysis.margins import (
    ROUNDED_GROWTH,
    check_single_rate,
    frequency_grid,
    growth_of,
    loop_at,
    places_of,
    plants_of,
)
from flexarm.control.analysis.sampled_loop import ComplexArray, SampledLoop
from flexarm.control.analysis.structured import structured_bound
from flexarm.control.contract.base import Controller
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model import Hardware

if TYPE_CHECKING:
    import xarray as xr

#: Smallest mean square of the change in a direction, relative to that in the largest one.
_FLAT = 1e-8
#: Iterations of the cover. More than 20 reduce the bounds of the how-to page by less than 1 %.
_COVERINGS = 20


@public_call
def robustness(
    controller: Controller,
    plants: Arm | Sequence[Arm] | Mapping[str, Arm],
    posture: ArrayLike | None = None,
    *,
    sensitivity: float = 2.0,
    hardware: Hardware | None = None,
) -> xr.Dataset:
    """Return whether a sampled loop is robust for all plants around a sample of plants.

    At each frequency a ball of matrices with fitted weights covers the loop transfers of all plants
    at the motors. The loop is stable for all plants with transfers in these balls if
    ``stability_mu`` is below one at all frequencies, and its sensitivity is bounded for all of them
    if ``performance_mu`` is. The balls contain more than arms, so that a loop with a value above
    one may be stable for all arms; it is for balls that are smaller by this factor.

    Args:
        controller: a controller with a ``step``, see `loop_margins`.
        plants: sample of the uncertain arm, such as arms made by `varied`; the model of the
            controller belongs to the sample, too.
        posture: (joints,) rad; None for the first posture of the design, or zeros.
        sensitivity: largest accepted norm of the sensitivity at the motors, above 1.
        hardware: instruments and motors; None for exact ones.

    Returns:
        Dataset over ``frequency`` (rad/s): ``uncertainty``, the largest relative change of the loop
        from the first plant in the sample, for torques that are normalised by the mass matrix;
        ``weight``, a first-order weight (low + t s) / (1 + t s / high) that covers it, with its
        numbers ``low``, ``high`` and ``time`` (t, s) as attributes; ``stability_mu`` and
        ``performance_mu``; and the maxima of both, ``worst_stability_mu`` and
        ``worst_performance_mu``, infinite if a loop of the sample is unstable.

    Raises:
        InputError: as for `loop_margins`, or if the plants do not have the same number of unstable
            poles, so that the zeros of the return difference do not show stability.
        EquilibriumError: if an arm has no equilibrium at the posture.

    Warns:
        LargeDeflectionWarning: if a link of an arm bends too far at rest, once for all arms.

    Skogestad and Postlethwaite 2005, chapter 8, for the tests; (C.146) to (C.149).
    """
    import xarray as xr

    rule = "be greater than 1"
    accepted = check_number("sensitivity", sensitivity, lambda value: value > 1.0, rule)
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    named = plants_of(controller, plants)
    own = getattr(controller, "arm", None)
    arms = [*([own] if isinstance(own, Arm) else []), *named.values()]
    places = places_of(controller, arms[0], posture, None, "posture")
    if posture is not None and len(places) > 1:
        raise InputError(Problem("posture", "be one posture", f"{len(places)} of them"))
    at = places[0][1]
    with one_warning() as bent:
        loops = [loop_at(controller, arm, at, hardware) for arm in arms]
    warn_of_first(bent)
    for loop in loops:
        check_single_rate(loop)
    _check_unstable_poles(loops)
    angles = np.unique(np.concatenate([frequency_grid(loop) for loop in loops]))
    returned = np.array([_transfer(loop, angles) for loop in loops])
    root = np.linalg.cholesky(arms[0].rigid().mass_matrix(at))
    stable = all(growth_of(loop) <= 0.0 for loop in loops)
    mu = _bounds(returned, root, accepted) if stable else np.full((2, len(angles)), np.inf)
    omega = angles / loops[0].sample_time
    table = xr.Dataset(coords={"frequency": ("frequency", omega, {"units": "rad/s"})})
    relative = _relative(returned, root)
    numbers, weight = fitted_weight(omega, relative)
    for name, meaning, values, more in (
        ("uncertainty", "largest relative change of the loop", relative, {}),
        ("weight", "first-order weight that covers the uncertainty", weight, numbers),
        ("stability_mu", "upper bound of mu, robust stability", mu[0], {}),
        ("performance_mu", "upper bound of mu, robust performance", mu[1], {}),
    ):
        labels: dict[str, Any] = {"units": "1", "long_name": meaning, **more}
        table[name] = ("frequency", values, labels)
        if name.endswith("mu"):
            table[f"worst_{name}"] = ((), values.max(), labels)
    return table


def _check_unstable_poles(loops: Sequence[SampledLoop]) -> None:
    """Raise if plants have different numbers of poles outside the unit circle.

    Raises:
        InputError: in this case.
    """
    growth = [np.log(np.abs(np.linalg.eigvals(loop.plant.A[0])) + 1e-300) for loop in loops]
    counts = [int(np.sum(each > ROUNDED_GROWTH)) for each in growth]
    if len(set(counts)) > 1:
        hint = "Choose a posture in which gravity acts alike on all plants."
        rule = "have the same number of unstable poles"
        raise InputError(Problem("plants", rule, ", ".join(map(str, counts)), hint))


def _transfer(loop: SampledLoop, angles: FloatArray) -> ComplexArray:
    """Return the loop transfer (f, joints, joints) at the motors, for negative feedback."""
    S = loop.sensitivity(np.exp(1j * angles))
    found: ComplexArray = np.linalg.inv(S) - np.eye(S.shape[1])
    return found


def _bounds(returned: ComplexArray, root: FloatArray, accepted: float) -> FloatArray:
    """Return the bounds (2, f) for stability and performance; (C.147) and (C.148)."""
    normal = np.linalg.solve(root, returned @ root)
    centre, left, right = covering_ball(normal)
    m = centre.shape[1]
    S = np.linalg.inv(np.eye(m) + centre)
    # The uncertainty acts on normalised torques, the sensitivity on those of the motors.
    inverse = np.linalg.inv(root)
    whole = np.block(
        [
            [-right @ S @ left, right @ S @ inverse],
            [-root @ S @ left / accepted, root @ S @ inverse / accepted],
        ]
    )
    stability = structured_bound(whole[:, :m, :m], [m])
    return np.array([stability, structured_bound(whole, [m, m])])


def covering_ball(samples: ComplexArray) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
    """Return matrices (f, m, m) C, W and V: all samples (k, f, m, m) are C + W Delta V; (C.146).

    ``Delta`` is a complex matrix with a norm of at most one. The weights W and V are large in the
    directions in which the samples differ most. Therefore a vibration whose frequency varies does
    not enlarge the set in other directions. Samples at the border get a larger share in the centre
    and the weights, in the manner of the smallest ellipsoid around points (Titterington 1978).
    """
    share = np.full(samples.shape[:2], 1.0 / len(samples))
    for _ in range(_COVERINGS):
        part = share[:, :, None, None]
        centre = (part * samples).sum(axis=0)
        away = samples - centre
        turned = np.conj(np.swapaxes(away, -1, -2))
        left = _fourth_root((part * (away @ turned)).sum(axis=0))
        right = _fourth_root((part * (turned @ away)).sum(axis=0))
        inside = np.linalg.solve(left, away) @ np.linalg.inv(right)
        sizes = np.linalg.svd(inside, compute_uv=False)[..., 0]
        size = sizes.max(axis=0)
        # Without the smallest number, equal samples would have no share.
        share = share * (sizes**2 + np.finfo(float).tiny)
        share /= share.sum(axis=0)
    return centre, size[:, None, None] * left, right


def _fourth_root(squares: ComplexArray) -> ComplexArray:
    """Return the fourth roots (f, m, m) of positive matrices (f, m, m)."""
    values, vectors = np.linalg.eigh(squares)
    least = _FLAT * values[:, -1:] + np.finfo(float).tiny
    roots = np.maximum(values, least) ** 0.25
    found: ComplexArray = (vectors * roots[:, None, :]) @ np.conj(np.swapaxes(vectors, -1, -2))
    return found


def _relative(returned: ComplexArray, root: FloatArray) -> FloatArray:
    """Return the largest relative change (f,) from the first loop; (C.149)."""
    change = np.linalg.solve(returned[0], returned) - np.eye(returned.shape[-1])
    normal = np.linalg.solve(root, change @ root)
    found: FloatArray = np.linalg.svd(normal, compute_uv=False)[..., 0].max(axis=0)
    return found


def fitted_weight(omega: FloatArray, size: FloatArray) -> tuple[dict[str, float], FloatArray]:
    """Return the numbers and the magnitude (f,) of a weight (low + t s) / (1 + t s / high).

    It covers ``size`` (f,) at all frequencies ``omega`` (f,) rad/s, and its mean logarithm over the
    logarithm of frequency is the least.
    """
    from scipy.optimize import minimize

    wanted = np.log(np.maximum(size, 1e-9))
    share = np.gradient(np.log(omega))
    share /= share.sum()

    def magnitude(numbers: FloatArray) -> FloatArray:
        low, high, time = np.exp(numbers)
        ahead = 1j * time * omega
        found: FloatArray = np.log(np.abs((low + ahead) / (1.0 + ahead / high)))
        return found

    middle = np.log(omega[int(np.argmax(wanted))])
    start = np.array([wanted[0], wanted.max(), -middle])
    covers = {"type": "ineq", "fun": lambda numbers: magnitude(numbers) - wanted}
    done = minimize(lambda n: share @ magnitude(n), start, method="SLSQP", constraints=[covers])
    # The optimiser may violate a constraint slightly: raise the weight to cover all of them.
    short = float((wanted - magnitude(done.x)).max())
    raised = done.x + max(short, 0.0)
    numbers = dict(zip(("low", "high", "time"), np.exp(raised).tolist(), strict=True))
    return numbers, np.exp(magnitude(raised))
