"""Iterative learning control: ``flexarm.iterative_learning``.

Laws of learning: theory page "control-learning", (C.102) to (C.106).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning
from flexarm.base.arguments import check_choice, check_each, check_kind, check_options
from flexarm.base.errors import (
    InputError,
    Problem,
    UnstableLoopWarning,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import linalg, scipy, xr
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model import Hardware
from flexarm.model.arm.spec import UNDRIVEN, serial_only
from flexarm.model.quantities import Count, NonNegative, Positive
from flexarm.planning.learning.bench import (
    AddedTorque,
    Bench,
    check_linear,
    joint_errors,
    window_of,
)
from flexarm.simulation.calls.run import simulate

OUTPUTS = ("tip", "joint_angle")
#: Arguments of ``simulate`` that a trial does not determine.
_OPTIONS = tuple(
    name
    for name in signature(simulate).parameters
    if name not in ("torque", "prescribed", "rate", "events")
)


@public_call
def iterative_learning(
    arm: Arm,
    reference: Reference,
    controller: Controller,
    *,
    output: str = "tip",
    trials: Count = 10,
    duration: float | None = None,
    interval: float | None = None,
    effort: NonNegative = 1e-6,
    change: NonNegative = 0.0,
    proportional: ArrayLike | None = None,
    derivative: ArrayLike = 0.0,
    lead: NonNegative = 0.0,
    cutoff: Positive | None = None,
    plant: Arm | None = None,
    hardware: Hardware | None = None,
    trial: Callable[[Controller], ArrayLike] | None = None,
    **options: Any,
) -> LearnedMotion:
    """Learn the torques of a repeated motion from the errors of each trial.

    Each trial starts from the same state. After it, the learned torques, which are added to those
    of the controller, are changed by its errors: by the model of the closed loop, so that squared
    errors and torques become least (norm-optimal learning), or without a model if ``proportional``
    is given.

    Args:
        arm: model of the arm. Learning without a model uses it for the prediction only.
        reference: motion of the joints; the tip is to follow the tip of the rigid arm.
        controller: feedback during the trials, with a ``step``.
        output: "tip", or "joint_angle", whose errors are learned.
        trials: number of trials.
        duration: s, of a trial, at least and by default to the end of the reference. The arm
            vibrates less at the end of the motion if the trial lasts longer.
        interval: s, in which the learned torque is constant, a multiple of the controller's sample
            time; by default the least with up to 400 intervals.
        effort: weight of the squared torques, relative to the squares of the errors that the most
            effective torques of the same size cause. A larger weight leaves torques of high
            frequency out, to which the model's errors belong.
        change: weight of the squared changes of the torques, likewise. It slows learning, and
            averages noise over trials.
        proportional: (joints,) or one number, N m/rad: gain of learning without a model, such as
            half of the controller's own; None for learning with the model. Errors of the tip are
            converted to joint angles by the rigid arm.
        derivative: N m s/rad, gain of the rate of the errors, likewise.
        lead: s, by which a torque precedes the error that changes it, besides one interval; about
            the delay of the closed loop.
        cutoff: Hz, of a filter without phase shift for the learned torques; None for none. Without
            a model, learning needs one below the frequency at which the motion opposes the torque.
        plant: simulated arm, if it differs from ``arm``.
        hardware: instruments and motors. An instrument with the name of ``output`` measures the
            errors; its noise differs in each trial.
        trial: your own trial, instead of a simulation: a function of a controller that returns
            the outputs (N, 2) m or (N, joints) rad at the ends of the intervals.
        options: further arguments of ``simulate``, such as ``loads``.

    Returns:
        The learned torques and their controller, the errors of all trials, and the convergence
        that the model predicts and that the trials show.

    Raises:
        InputError: if an argument has the wrong type or value, arguments contradict each other, or
            the controller has no ``step`` or needs readings other than joint angles,
            joint rates and strain.
        SimulationError: if a trial stops early.

    Warns:
        UnstableLoopWarning: if learning is predicted to diverge.
        LargeDeflectionWarning: if a link exceeds the linear beam theory.

    The model is the closed loop, linearised along a simulated trial; it excludes motors and errors
    of instruments. Theory page "control-learning".

    References:
        D. A. Bristow, M. Tharayil and A. G. Alleyne, IEEE Control Systems Magazine 26(3) (2006)
        96-114.
        S. Arimoto, S. Kawamura and F. Miyazaki, J. Robotic Systems 1 (1984) 123-140.
        S. Gunnarsson and M. Norrlof, Automatica 37 (2001) 2011-2016.
    """
    serial_only(arm.spec, "iterative learning", UNDRIVEN)
    check_reference(reference)
    check_controller("controller", controller)
    check_choice("output", output, OUTPUTS)
    if trial is not None and not callable(trial):
        raise InputError(Problem("trial", "be a function of a controller", shown(trial)))
    own = {"plant": plant, "hardware": hardware, **options}
    given = [name for name, value in own.items() if value is not None]
    if trial is not None and given:
        raise InputError(Problem("trial", f"cannot be combined with {given[0]}"))
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    check_options(options, _OPTIONS, "iterative_learning")
    check_linear(controller, arm, reference)
    window = window_of(arm, reference, controller, duration, interval)
    rates = _per_joint("derivative", derivative, arm.n_joints)
    gains = None
    if proportional is not None:
        gains = _per_joint("proportional", proportional, arm.n_joints)
    if gains is None and (np.any(rates) or lead):
        raise InputError(Problem("proportional", "is required with derivative or lead"))
    if gains is not None and change:
        raise InputError(Problem("change", "cannot be combined with proportional"))
    if gains is None and effort + change == 0.0:
        hint = "Without them, the torques would be arbitrarily large."
        raise InputError(Problem("effort", "be positive if change is 0", "0", hint))
    bench = Bench(arm, reference, window, output, plant, hardware, trial, options)
    none = np.zeros((window.intervals, arm.n_joints))
    with one_warning():
        unchanged = AddedTorque(controller, none, window.interval)
        P = bench.model(unchanged)
        if gains is None:
            law = norm_optimal(P, effort, change)
        else:
            inverse = joint_errors(arm, reference, window, output)
            ahead = min(round(lead / window.interval), window.intervals - 1)
            law = proportional_derivative(inverse, gains, rates, ahead, window.interval)
        if cutoff is not None:
            law = filtered(law, arm.n_joints, cutoff, window.interval)
        learned = _learn(bench, unchanged, law, P, trials)
    return learned


def _learn(
    bench: Bench, controller: AddedTorque, law: _Law, P: FloatArray, trials: int
) -> LearnedMotion:
    """Carry out the trials."""
    T = law.contraction(P)
    rate, bound = float(np.max(np.abs(np.linalg.eigvals(T)))), float(np.linalg.norm(T, 2))
    if rate >= 1.0 - 1e-9:  # changes that are never learned have an eigenvalue of one, rounded
        text = (
            f"The learning is predicted to diverge: after many trials the change of torque grows "
            f"by a factor of {rate:.3g} in each. Reduce the gains or the cutoff, or change the "
            "lead."
        )
        warn_caller(text, UnstableLoopWarning)
    shape = controller.torque.shape
    torques, errors, predicted = [controller.torque], [bench.errors(controller)], []
    for _ in range(1, trials):
        following = law.Q @ torques[-1].ravel() + law.G @ errors[-1].ravel()
        torques.append(following.reshape(shape))
        controller = AddedTorque(controller.inner, torques[-1], controller.interval)
        errors.append(bench.errors(controller))
    v, e = torques[0].ravel(), errors[0].ravel()
    for _ in range(trials):
        predicted.append(e.reshape(errors[0].shape))
        following = law.Q @ v + law.G @ e
        v, e = following, e - P @ (following - v)
    changes = np.linalg.norm(np.diff(torques, axis=0), axis=(1, 2))
    undefined = np.full(max(trials - 2, 0), np.nan)
    rate_of_change = np.divide(changes[1:], changes[:-1], out=undefined, where=changes[:-1] > 0.0)
    history = np.array(torques), np.array(errors), np.array(predicted)
    rates = rate, bound, rate_of_change
    return LearnedMotion(controller, controller.interval, *history, *rates, bench.result)


def _per_joint(name: str, value: ArrayLike, joints: int) -> FloatArray:
    found: FloatArray = np.full(joints, check_each(name, value, joints))
    if np.any(found < 0.0):
        raise InputError(Problem(name, "be at least 0", str(found.min())))
    return found


@dataclass(frozen=True, eq=False)
class LearnedMotion:
    """Torques learned in repeated trials of a motion, their errors, and the rate of convergence.

    Attributes:
        controller: the controller with the learned torque added, for ``simulate`` or your own loop.
        interval: s, time in which a learned torque is constant.
        torques: (trials, N, joints) N m, added in each trial.
        errors: (trials, N, outputs) m or rad, reference minus output at the ends of the intervals.
        predicted_errors: of the same shape, as the model predicts them from the first trial.
        predicted_rate: factor of the change of torque from trial to trial after many trials: the
            spectral radius of the learning; (C.103). Learning converges if it is below one.
        predicted_bound: largest factor in any trial, the largest singular value. If it is below
            one, the change of torque decreases in every trial.
        rate: (trials - 2,), measured factors: norm of each change of torque over that before it;
            NaN after no change.
        result: dataset of the last trial; None for trials of your own.
    """

    controller: AddedTorque
    interval: float
    torques: FloatArray
    errors: FloatArray
    predicted_errors: FloatArray
    predicted_rate: float
    predicted_bound: float
    rate: FloatArray
    result: xr.Dataset | None

    def __repr__(self) -> str:
        first, last = self.error_rms[0], self.error_rms[-1]
        return (
            f"<flexarm.LearnedMotion: {len(self.torques)} trials, error {first:.3g} to "
            f"{last:.3g} RMS, predicted rate {self.predicted_rate:.3g}>"
        )

    @property
    def time(self) -> FloatArray:
        """Ends of the intervals (N,), s."""
        return self.interval * np.arange(1, self.torques.shape[1] + 1)

    @property
    def error_rms(self) -> FloatArray:
        """Root of the mean squared length of the error, for each trial (trials,), m or rad."""
        return _rms(self.errors)

    @property
    def predicted_error_rms(self) -> FloatArray:
        """The same for ``predicted_errors``, (trials,)."""
        return _rms(self.predicted_errors)


def _rms(errors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.mean(np.sum(errors**2, axis=2), axis=1)))


#: Order of the Butterworth filter of which the Q-filter has the squared magnitude.
_ORDER = 2


class _Law(NamedTuple):
    """Linear law of learning: the torques v of the next trial are ``Q v + G e``.

    Over the torques of all joints in all intervals, (N joints,), and the errors of all outputs at
    their ends, (N p,).
    """

    Q: FloatArray
    G: FloatArray

    def contraction(self, P: FloatArray) -> FloatArray:
        """Return the matrix that multiplies the change of torques in each trial; (C.103)."""
        return np.asarray(self.Q - self.G @ P)


def norm_optimal(P: FloatArray, effort: float, change: float) -> _Law:
    """Return the law of least errors, torques and changes of torques; (C.104).

    ``P`` (N p, N joints) is the lifted model; the weights ``effort`` of torques and ``change`` of
    their changes are relative to its largest singular value squared.
    """
    square = P.T @ P
    # The largest eigenvalue of P^T P is the square of the largest singular value of P.
    scale = float(np.linalg.eigvalsh(square)[-1])
    eye = np.eye(len(square))
    factor = linalg.cho_factor(square + (effort + change) * scale * eye)
    return _Law(
        linalg.cho_solve(factor, square + change * scale * eye), linalg.cho_solve(factor, P.T)
    )


def proportional_derivative(
    inverse: FloatArray,
    proportional: FloatArray,
    derivative: FloatArray,
    lead: int,
    interval: float,
) -> _Law:
    """Return the law of proportional and derivative learning; (C.105).

    ``inverse`` (N, joints, p) are joint errors per output error; a torque precedes its error by
    ``lead`` intervals (s). The gains (joints,) are in N m/rad and N m s/rad.
    """
    count, m, p = inverse.shape
    later = np.eye(count)[np.minimum(np.arange(count) + lead, count - 1)]
    rate = np.gradient(later, interval, axis=0)
    weights = proportional[:, None, None] * later + derivative[:, None, None] * rate
    G = np.einsum("jik,kjo->ijko", weights, inverse)
    return _Law(np.eye(count * m), G.reshape(count * m, count * p))


def filtered(law: _Law, joints: int, cutoff: float, interval: float) -> _Law:
    """Return a law whose torques pass through a Q-filter without phase shift; (C.106)."""
    # The filter multiplies the cosine transform by the squared magnitude of a Butterworth filter,
    # so it is symmetric, preserves constants, and enlarges nothing.
    count = len(law.Q) // joints
    return _Law(*(_smooth(matrix, count, cutoff, interval) for matrix in law))


def _smooth(matrix: FloatArray, count: int, cutoff: float, interval: float) -> FloatArray:
    hertz = np.arange(count) / (2.0 * count * interval)
    gain = 1.0 / (1.0 + (hertz / cutoff) ** (2 * _ORDER))
    columns = matrix.reshape(count, -1)
    spectrum = gain[:, None] * scipy.fft.dct(columns, axis=0, norm="ortho")
    return np.asarray(scipy.fft.idct(spectrum, axis=0, norm="ortho").reshape(matrix.shape))
