"""Robust stability and performance of a sampled loop, and its linear models for other libraries."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import check_kind, check_number
from flexarm.base.errors import InputError, Problem, public_call
from flexarm.base.late import optimize, xr
from flexarm.control.analysis.margins import (
    ROUNDED_GROWTH,
    check_single_rate,
    checked_surroundings,
    frequency_grid,
    loop_at,
    place_of,
    plants_of,
    stability_of,
)
from flexarm.control.analysis.sampled_loop import ComplexArray, Response, SampledLoop
from flexarm.control.analysis.structured import structured_bound
from flexarm.control.contract.base import Controller, Reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.linear.models.state_space import StateSpaceModel, control_system
from flexarm.model import Contact, Hardware

if TYPE_CHECKING:
    import control


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
    rule = "be greater than 1"
    accepted = check_number("sensitivity", sensitivity, lambda value: value > 1.0, rule)
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    named = plants_of(controller, plants)
    own = getattr(controller, "arm", None)
    arms = [*([own] if isinstance(own, Arm) else []), *named.values()]
    _, at = place_of(controller, arms[0], posture)
    with one_warning():
        loops = [loop_at(controller, arm, at, hardware) for arm in arms]
    for loop in loops:
        check_single_rate(loop)
    _check_unstable_poles(loops)
    angles = np.unique(np.concatenate([frequency_grid(loop) for loop in loops]))
    # Loop transfer (f, joints, joints) of each plant at the motors, for negative feedback.
    inverse = np.linalg.inv([loop.sensitivity(np.exp(1j * angles)) for loop in loops])
    returned = inverse - np.eye(inverse.shape[-1])
    root = np.linalg.cholesky(arms[0].rigid().mass_matrix(at))
    stable = all(stability_of(loop)[0] <= 0.0 for loop in loops)
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
    """Raise if plants have different numbers of poles outside the unit circle."""
    growth = [np.log(np.abs(np.linalg.eigvals(loop.plant.A[0])) + 1e-300) for loop in loops]
    counts = [int(np.sum(each > ROUNDED_GROWTH)) for each in growth]
    if len(set(counts)) > 1:
        hint = "Choose a posture in which gravity acts alike on all plants."
        rule = "have the same number of unstable poles"
        raise InputError(Problem("plants", rule, ", ".join(map(str, counts)), hint))


def _bounds(returned: ComplexArray, root: FloatArray, accepted: float) -> FloatArray:
    """Return the bounds (2, f) for stability and performance; (C.147) and (C.148)."""
    normal = np.linalg.solve(root, returned @ root)
    centre, left, right = covering_ball(normal)
    m = centre.shape[1]
    S = np.linalg.inv(np.eye(m) + centre)
    # The uncertainty acts on normalised torques, the sensitivity on those of the motors.
    inverse = np.linalg.inv(root)
    first = [-right @ S @ left, right @ S @ inverse]
    second = [-root @ S @ left / accepted, root @ S @ inverse / accepted]
    whole = np.block([first, second])
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
    return np.asarray((vectors * roots[:, None, :]) @ np.conj(np.swapaxes(vectors, -1, -2)))


def _relative(returned: ComplexArray, root: FloatArray) -> FloatArray:
    """Return the largest relative change (f,) from the first loop; (C.149)."""
    change = np.linalg.solve(returned[0], returned) - np.eye(returned.shape[-1])
    normal = np.linalg.solve(root, change @ root)
    return np.asarray(np.linalg.svd(normal, compute_uv=False)[..., 0].max(axis=0))


def fitted_weight(omega: FloatArray, size: FloatArray) -> tuple[dict[str, float], FloatArray]:
    """Return the numbers and the magnitude (f,) of a weight (low + t s) / (1 + t s / high).

    It covers ``size`` (f,) at all frequencies ``omega`` (f,) rad/s, and its mean logarithm over the
    logarithm of frequency is the least.
    """
    wanted = np.log(np.maximum(size, 1e-9))
    share = np.gradient(np.log(omega))
    share /= share.sum()

    def magnitude(numbers: FloatArray) -> FloatArray:
        low, high, time = np.exp(numbers)
        ahead = 1j * time * omega
        return np.asarray(np.log(np.abs((low + ahead) / (1.0 + ahead / high))))

    middle = np.log(omega[int(np.argmax(wanted))])
    start = np.array([wanted[0], wanted.max(), -middle])
    covers = {"type": "ineq", "fun": lambda numbers: magnitude(numbers) - wanted}
    done = optimize.minimize(
        lambda n: share @ magnitude(n), start, method="SLSQP", constraints=[covers]
    )
    # The optimiser may violate a constraint slightly: raise the weight to cover all of them.
    short = float((wanted - magnitude(done.x)).max())
    raised = done.x + max(short, 0.0)
    numbers = dict(zip(("low", "high", "time"), np.exp(raised).tolist(), strict=True))
    return numbers, np.exp(magnitude(raised))


@dataclass(frozen=True, eq=False, repr=False)
class SampledModel(StateSpaceModel):
    """Sampled linear model of small deviations: x+ = A x + B u, y = C x + D u.

    Attributes:
        A, B, C, D: (n, n), (n, inputs), (outputs, n), (outputs, inputs).
        inputs, outputs: names; the units are those of the torques and the readings.
        sample_time: time between samples, s.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sample_time: float

    def _about(self) -> str:
        return f", {self.sample_time:g} s"

    def _response(self, omega: FloatArray) -> NDArray[np.complex128]:
        response = Response(self.A, self.B, self.C)(np.exp(1j * self.sample_time * omega))
        return (response + self.D).astype(np.complex128)

    @public_call
    def to_control(self) -> control.StateSpace:
        """Convert to a sampled state-space system of python-control with the same names.

        Raises:
            InputError: if python-control is not installed.
        """
        return control_system(self, dt=self.sample_time)


class LoopModels(NamedTuple):
    """The two parts of a sampled loop: the loop is closed with positive feedback."""

    plant: SampledModel  # from the requested torques, by hold, motors and instruments, to readings
    controller: SampledModel  # from the readings to the requested torques


@public_call
def loop_models(
    controller: Controller,
    plant: Arm | None = None,
    posture: ArrayLike | None = None,
    *,
    hardware: Hardware | None = None,
    contacts: Sequence[Contact] = (),
    reference: Reference | None = None,
) -> LoopModels:
    """Return the linear models of a controller and of the sampled arm that it controls.

    They are the models that `loop_margins` uses. The sign of the controller includes that of the
    feedback: ``control.feedback(plant, controller, sign=1)`` is the closed loop.

    Args:
        controller: a controller with a ``step`` that can be linearised, as all built-in ones except
            `EstimatorController`, `NonlinearMPC`, `RBFAdaptive` and `RepetitiveControl`.
        plant: the arm; None for the model of the controller.
        posture: (joints,) rad; None for the first posture of the design, or zeros if the
            controller has none. With a ``reference``, its time (s) instead; None for its start.
        hardware: instruments and motors; None for exact ones.
        contacts: surfaces; those in contact with the arm at rest belong to the plant, without
            friction.
        reference: motion that presses (`pressed_motion`), for the force controllers.

    Raises:
        InputError: if the controller has no ``step``, an instrument has its own
            ``sample_time``, or an argument has the wrong shape.
        EquilibriumError: if the arm has no equilibrium at the posture.

    Warns:
        LargeDeflectionWarning: if a link of the arm bends too far at rest.
    """
    if plant is not None:
        check_kind("plant", plant, Arm)
    bare = checked_surroundings(hardware, contacts, reference)
    (arm,) = plants_of(controller, plant, "plant").values()
    rule = "be one posture, or one time of the reference"
    t, angles = place_of(controller, arm, posture, reference, rule)
    with one_warning():
        loop = loop_at(controller, arm, angles, hardware, bare, reference, t)
    check_single_rate(loop)
    torques = tuple(f"torque[{number}]" for number in arm.joint_numbers)
    A, B, C, _ = loop.plant[:4]
    readings = loop.plant.outputs
    through = np.zeros((len(readings), len(torques)))
    return LoopModels(
        SampledModel(A[0], B, C[0], through, torques, readings, loop.sample_time),
        SampledModel(*loop.controller, readings, torques, loop.sample_time),
    )
