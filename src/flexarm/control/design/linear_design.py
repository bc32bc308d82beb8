"""Linear-quadratic regulator and Kalman filter of a sampled arm: theory page "control-linear"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.arguments import check_each
from flexarm.base.errors import InputError, Problem, shown
from flexarm.base.late import linalg
from flexarm.control.design.loop_hardware import LoopHardware, state_sizes
from flexarm.control.design.minimal import MinimalCoordinates
from flexarm.control.hardware.measurement import FloatArray
from flexarm.control.hardware.sampled_plant import SampledPlant, held
from flexarm.linear.models.state_space import INPUTS, LinearModel, component_places
from flexarm.model.wording import nearest

#: Energy of the unknown elastic forces relative to that of `bending`, and acceptable relative
#: size of the bending, both for an uncertainty of one: (C.39). With these values and an uncertainty
#: of 0.3, LQG with its default weights is stable on the three arms of
#: docs/performance/measure_robustness.py: links 30 % softer and stiffer, and twice the payload.
_NOISE, _BEND = 0.25, 0.02
#: Integral of the angles between the chords of the links, by the measured joint angles and strains.
CHORD = "chord_angle"
#: Most doublings of a Riccati equation, and the relative change at its solution.
_DOUBLINGS, _CONVERGED = 60, 1e-13


@dataclass(frozen=True, eq=False)
class Design:
    """Gains at one posture.

    The state x is the deviation of (q, qd), n = 2 dof; z are k integrals. For mechanisms, read dof
    as the number of `MinimalCoordinates`, and dof - joints as that of the unbalanced ones. A design
    with hardware adds the states of motors and instruments to x, and to n.
    """

    posture: FloatArray  # (joints,) rad
    sag: FloatArray  # (dof - joints,) elastic coordinates at rest in the posture
    A: FloatArray  # of the sampled arm, (n, n) and (n, joints); C: of the measurement, (p, n)
    B: FloatArray  # of the sampled arm, (n, n) and (n, joints); C: of the measurement, (p, n)
    B_elastic: FloatArray  # (n, dof - joints), of forces on the elastic coordinates
    C: FloatArray
    integrated: FloatArray  # (k, n): z (k,) increases by ``integrated`` x at each sample
    gain: FloatArray  # (joints, n + k): torque = -gain (x, z)
    cost: FloatArray  # (n + k, n + k): the minimum cost from a state is (x, z)' cost (x, z)
    weight: FloatArray  # weights Q and R of the cost, (n + k, n + k) and (joints, joints)
    torque_weight: FloatArray  # weights Q and R of the cost, (n + k, n + k) and (joints, joints)
    estimator: FloatArray  # (n, p), gain of the innovation in the correction of the prediction
    prediction_covariance: FloatArray  # (n, n) of the prediction error
    innovation_covariance: FloatArray  # (p, p) of the measurement minus its prediction


@dataclass(frozen=True, eq=False)
class DesignRequirements:
    """Design requirements of a linear controller: acceptable deviations, and noise.

    Those of outputs are by name; disturbances are deviations of unmeasured inputs, constant over a
    sample; rates of all coordinates are relative to ``rate``.
    """

    acceptable: Mapping[str, ArrayLike]
    acceptable_torque: FloatArray  # (joints,) N m
    measured: Mapping[str, ArrayLike]  # standard deviations of the noise
    disturbance: Mapping[str, ArrayLike]
    integrated: Mapping[str, ArrayLike]  # the output to integrate and its acceptable integral
    rate: float  # typical joint rate, rad/s
    recovery: float = 0.0  # torque noise of the filter, relative to the acceptable torque
    rigidity_uncertainty: float = 0.0  # relative error of the links' stiffness
    #: rotations of the chords of the links by the strains (joints, gauges), if they are integrated
    chords: FloatArray | None = None


def sampled(
    model: LinearModel, sample_time: float, more: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return A and B of a model sampled exactly with zero-order-hold inputs; (C.22).

    ``more`` (dof, k): generalised forces of further inputs, whose columns are appended to B.
    """
    B = model.B
    if more is not None:
        pushes = np.linalg.solve(model.mass, more)
        B = np.hstack([B, np.vstack([np.zeros_like(pushes), pushes])])
    return held(model.A, B, sample_time)


def rows_of(model: LinearModel, names: Sequence[str]) -> FloatArray:
    """Return the rows of C for the outputs of the named channels, in this order."""
    return np.asarray(model.C[component_places(model.outputs, names)])


def sizes_of(argument: str, model: LinearModel, given: Mapping[str, ArrayLike]) -> FloatArray:
    """Return the numbers of a mapping, one for each component of its outputs or inputs."""
    labels = (*model.outputs, *model.inputs)
    found = [np.zeros(0)]
    for name, value in given.items():
        count = len(component_places(labels, [name]))
        sizes = check_each(f"{argument}[{name!r}]", value, count, positive=True)
        found.append(np.broadcast_to(sizes, (count,)))
    return np.concatenate(found)


def design(
    coordinates: MinimalCoordinates,
    posture: FloatArray,
    requirements: DesignRequirements,
    sample_time: float,
    hardware: LoopHardware | None = None,
) -> Design:
    """Design a regulator and a filter at rest in a posture, under gravity; (C.22) to (C.26).

    The motors and instruments of ``hardware`` are states of the model.

    Raises:
        InputError: if a name is unknown, a number is not positive, or no gains are stabilising.
        EquilibriumError: if the arm has no equilibrium at the posture.
    """
    integrated = dict(requirements.integrated)
    if CHORD in integrated:  # of the same components as the joint angles
        integrated["joint_angle"] = integrated.pop(CHORD)
    signals = () if hardware is None else hardware.signals
    listed = *requirements.acceptable, *requirements.measured, *signals, *integrated
    names = tuple(dict.fromkeys(listed))
    inputs = tuple(dict.fromkeys(["torque", *requirements.disturbance]))
    arm, elastic, unbalanced = coordinates.arm, coordinates.elastic, coordinates.unbalanced
    rest = coordinates.at_rest(posture)
    model = coordinates.linearized(rest, inputs, names, sliding=True)
    A, B_all = sampled(model, sample_time, np.eye(len(model.mass))[:, unbalanced])
    n, m = len(A), arm.n_joints
    # Passive joints have no torque: their columns of zeros leave their gains zero.
    B = B_all[:, :m] * coordinates.driven
    sizes = coordinate_sizes(arm)[coordinates.chosen]
    sizes = np.append(sizes, requirements.rate * sizes)
    C = rows_of(model, tuple(requirements.measured))
    plant = SampledPlant([A], B, [C], sample_time, frames=n)
    if hardware is not None:
        rows = {name: rows_of(model, (name,)) for name in signals}
        plant = hardware.plant(model.A, model.B[:, :m] * coordinates.driven, rows)
        sizes = state_sizes(plant, sizes, requirements.acceptable_torque)
    more = len(plant.A[0]) - n  # states of motors and instruments
    Z = sample_time * rows_of(model, tuple(integrated))
    if requirements.chords is not None:
        Z += sample_time * requirements.chords @ rows_of(model, ("strain",))
    motors = int(np.count_nonzero(coordinates.driven))
    if len(Z) > motors:
        rule = f"have at most one component for each joint of the arm ({motors})"
        raise InputError(Problem("integral", rule, str(len(Z))))
    scale = sizes_of("acceptable", model, requirements.acceptable)
    outputs = rows_of(model, tuple(requirements.acceptable)) / scale[:, None]
    windup = sizes_of("integral", model, integrated)
    weight = linalg.block_diag(outputs.T @ outputs, np.zeros((more, more)), np.diag(windup**-2.0))
    unsure = requirements.rigidity_uncertainty
    stiffness, bend_energy = bending(coordinates, model, requirements.acceptable_torque)
    weight[np.ix_(elastic, elastic)] += bend_weight(unsure, stiffness, bend_energy)
    torque_weight = np.diag(requirements.acceptable_torque**-2.0)
    strength = sizes_of("disturbance", model, requirements.disturbance)
    pushed = columns_of(model, tuple(requirements.disturbance), B_all) * strength
    # Covariance of torques and elastic forces that represent the model error: (C.39).
    forced = B_all[:, B_all.shape[1] - unbalanced.size :]
    bent = forced[:, np.isin(unbalanced, elastic)]
    torques = (requirements.recovery * requirements.acceptable_torque) ** 2
    unknown = B * torques @ B.T + _NOISE * unsure**2 * bend_energy * bent @ stiffness @ bent.T
    noise = np.diag(sizes_of("measured", model, requirements.measured) ** 2)
    disturbed = np.pad(pushed @ pushed.T + unknown, (0, more))
    Z, forced = np.pad(Z, ((0, 0), (0, more))), np.pad(forced, ((0, more), (0, 0)))
    gain, cost = _fed_back(plant, Z, weight, torque_weight, np.append(sizes, windup))
    filtered = _estimated(plant, n, disturbed, noise, sizes)
    sag = np.delete(rest.q, arm.joint_index)
    at_rest = posture, sag, plant.A[0], plant.B, forced
    return Design(*at_rest, plant.C[0], Z, gain, cost, weight, torque_weight, *filtered)


def _fed_back(
    plant: SampledPlant,
    integrated: FloatArray,
    weight: FloatArray,
    torque_weight: FloatArray,
    sizes: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return gain and cost of the regulator with integrals; zero for states of instruments."""
    n, k = len(plant.A[0]), len(integrated)
    A = np.block([[plant.A[0], np.zeros((n, k))], [integrated, np.eye(k)]])
    B = np.vstack([plant.B, np.zeros((k, plant.B.shape[1]))])
    fed = np.r_[: plant.frames, n : n + k]
    square = np.ix_(fed, fed)
    gain, cost = np.zeros((plant.B.shape[1], n + k)), np.zeros((n + k, n + k))
    gain[:, fed], cost[square] = regulator(
        A[square], B[fed], weight[square], torque_weight, sizes[fed]
    )
    return gain, cost


def _estimated(
    plant: SampledPlant, states: int, disturbed: FloatArray, noise: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the results of `kalman`; zero for the states of motors, which are known.

    ``states``: number of those of the arm.
    """
    A, C = plant.A[0], plant.C[0]
    unsure = np.r_[:states, plant.frames : len(A)]
    square = np.ix_(unsure, unsure)
    gain, spread = np.zeros((len(A), len(C))), np.zeros(A.shape)
    gain[unsure], spread[square], innovation = kalman(
        A[square], C[:, unsure], disturbed[square], noise, sizes[unsure]
    )
    return gain, spread, innovation


def bending(
    coordinates: MinimalCoordinates, model: LinearModel, acceptable_torque: FloatArray
) -> tuple[FloatArray, float]:
    """Return the stiffness (k, k) of the elastic coordinates, and a typical elastic energy, J.

    The energy is that of the bending when each joint accelerates the arm with its acceptable torque
    (joints,) N m, summed over the joints.
    """
    joints, elastic = coordinates.led, coordinates.elastic
    mass, stiffness = model.mass, model.stiffness[np.ix_(elastic, elastic)]
    stiffness = 0.5 * (stiffness + stiffness.T)
    numbers = np.searchsorted(coordinates.arm.joint_index, coordinates.chosen[joints])
    turned = np.linalg.solve(mass[np.ix_(joints, joints)], np.diag(acceptable_torque[numbers]))
    force = mass[np.ix_(elastic, joints)] @ turned
    return stiffness, 0.5 * float(np.sum(force * np.linalg.solve(stiffness, force)))


def bend_weight(unsure: float, stiffness: FloatArray, energy: float) -> FloatArray:
    """Return the weight (k, k) of the elastic coordinates for an uncertain rigidity; (C.39)."""
    if unsure == 0.0:
        return np.zeros_like(stiffness)
    return np.asarray((unsure / _BEND) ** 2 / energy * stiffness)


def columns_of(model: LinearModel, names: Sequence[str], B: FloatArray) -> FloatArray:
    """Return the columns of B for the named inputs, in this order."""
    return np.asarray(B[:, component_places(model.inputs, names)])


def regulator(
    A: FloatArray, B: FloatArray, weight: FloatArray, torque_weight: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the gain and the cost of the linear-quadratic regulator; (C.23).

    The equation is solved for states in the ratio of their ``sizes`` (n,) and for torques relative
    to their weights, so that all weights are about one. Otherwise rounding depends on the units.
    """
    sizes = sizes / np.max(np.diag(weight) * sizes**2) ** 0.5
    torque, square = np.diag(torque_weight) ** -0.5, np.outer(sizes, sizes)
    A, B = A * sizes / sizes[:, None], B * torque / sizes[:, None]
    P = _riccati("acceptable", A, B, weight * square, np.eye(torque.size))
    gain = linalg.solve(np.eye(torque.size) + B.T @ P @ B, B.T @ P @ A, assume_a="pos")
    _check_stable("acceptable", A - B @ gain)
    return gain * torque[:, None] / sizes, P / square


def preview_gain(item: Design, steps: int, stride: int) -> FloatArray:
    """Return preview gains (joints, 1 + steps / stride, dof - joints) of elastic forces; (C.27).

    Forces are evaluated at every ``stride``-th sample and interpolated linearly between them.
    """
    push, _ = regulated(item)
    inner = item.torque_weight + push.T @ item.cost @ push
    return previewed(item, linalg.solve(inner, push.T, assume_a="pos"), steps, stride)


def regulated(item: Design) -> tuple[FloatArray, FloatArray]:
    """Return B (n + k, joints) and the regulator's loop (n + k, n + k), with integrals."""
    n, k = len(item.A), len(item.integrated)
    push = np.vstack([item.B, np.zeros((k, item.B.shape[1]))])
    whole = np.block([[item.A, np.zeros((n, k))], [item.integrated, np.eye(k)]])
    return push, np.asarray(whole - push @ item.gain)


def previewed(item: Design, left: FloatArray, steps: int, stride: int) -> FloatArray:
    """Return ``left`` times s_k of (C.27), the cost of elastic forces, for each preview node."""
    loop, forced = regulated(item)[1], item.cost[:, : len(item.A)] @ item.B_elastic
    gains = np.zeros((len(left), 1 + steps // stride, forced.shape[1]))
    for i in range(steps):
        gain = left @ forced
        node, part = divmod(i, stride)
        gains[:, node] += (1.0 - part / stride) * gain
        if part:
            gains[:, node + 1] += part / stride * gain
        forced = loop.T @ forced
    return gains


def kalman(
    A: FloatArray, C: FloatArray, disturbance: FloatArray, noise: FloatArray, sizes: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the Kalman gain and the covariances of prediction error and innovation; (C.25)."""
    reading = np.diag(noise) ** 0.5
    sizes = sizes / np.max(np.abs(C) * sizes / reading[:, None])
    square = np.outer(sizes, sizes)
    A, C = A * sizes / sizes[:, None], C * sizes / reading[:, None]
    P = _riccati("measured", A.T, C.T, disturbance / square, np.eye(reading.size))
    seen = C @ P @ C.T + np.eye(reading.size)
    gain: FloatArray = linalg.solve(seen, C @ P, assume_a="pos").T
    _check_stable("measured", A @ (np.eye(len(A)) - gain @ C))
    return gain * sizes[:, None] / reading, P * square, seen * np.outer(reading, reading)


def _riccati(
    argument: str, A: FloatArray, B: FloatArray, Q: FloatArray, R: FloatArray
) -> FloatArray:
    # Doubling first: SciPy orders eigenvalues, which fails for some equations by rounding and loses
    # digits of others.
    doubled = _doubled(A, B @ np.linalg.solve(R, B.T), Q)
    if doubled is not None and _stabilises(doubled, A, B, R):
        return doubled
    for balanced in (True, False):
        try:
            P: FloatArray = linalg.solve_discrete_are(A, B, Q, R, balanced=balanced)
        except (np.linalg.LinAlgError, ValueError):
            continue
        if _stabilises(P, A, B, R):
            return (P + P.T) / 2.0
    raise InputError(_unsolvable(argument))


def _stabilises(P: FloatArray, A: FloatArray, B: FloatArray, R: FloatArray) -> bool:
    """Return whether the gain of a solution exists and makes the loop stable."""
    try:
        gain = linalg.solve(R + B.T @ P @ B, B.T @ P @ A, assume_a="pos")
    except (np.linalg.LinAlgError, ValueError):
        return False
    return bool(np.max(np.abs(np.linalg.eigvals(A - B @ gain))) < 1.0)


def _doubled(A: FloatArray, G: FloatArray, H: FloatArray) -> FloatArray | None:
    """Return the solution of H = Q + A' H (I + G H)^-1 A by doubling, or None without one.

    Chu, Fan, Lin and Wang, Int. J. Control 77 (2004) 767. It keeps the equation symmetric, so that
    it also solves equations whose pencil SciPy cannot order.
    """
    for _ in range(_DOUBLINGS):
        inner = np.linalg.solve((np.eye(len(A)) + G @ H).T, A.T).T  # A (I + G H)^-1
        more = A.T @ H @ np.linalg.solve(np.eye(len(A)) + G @ H, A)
        G, A = G + inner @ G @ A.T, inner @ A
        H = H + 0.5 * (more + more.T)
        G = 0.5 * (G + G.T)
        if not np.all(np.isfinite(H)):
            return None
        if np.abs(more).max() <= _CONVERGED * np.abs(H).max():
            return H
    return None


def _check_stable(argument: str, loop: FloatArray) -> None:
    if not np.max(np.abs(np.linalg.eigvals(loop))) < 1.0:
        raise InputError(_unsolvable(argument))


def _unsolvable(argument: str) -> Problem:
    rule, hint = "does not detect an undamped mode", "Measure joint_angle."
    if argument == "acceptable":
        rule = "gives no weight to an undamped mode, so the cost does not detect it"
        hint = "Add joint_angle, or the tip of two joints in a posture that is not straight; and "
        hint += "name no integral that the joints cannot control there."
    return Problem(argument, rule, hint=hint)


def check_names(
    argument: str, given: object, allowed: Sequence[str], arm: Arm
) -> Mapping[str, ArrayLike]:
    """Return a mapping after checking that its names are allowed and exist on the arm."""
    rule = "be a mapping from " + ", ".join(map(repr, allowed)) + " to numbers"
    if not isinstance(given, Mapping):
        raise InputError(Problem(argument, rule, shown(given)))
    wrong = [name for name in given if not isinstance(name, str) or name not in allowed]
    if wrong:
        raise InputError(*(Problem(argument, rule, shown(n), nearest(n, allowed)) for n in wrong))
    if "strain" in given and not arm.gauges:
        raise InputError(Problem(argument, "has strain, but the arm has no gauges"))
    return given


#: Inputs that may act as unmeasured disturbances.
DISTURBANCES = INPUTS
