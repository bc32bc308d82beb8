"""Iterative learning control: ``flexarm.iterative_learning``."""

from __future__ import annotations

from collections.abc import Callable
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.bending import one_warning, warn_of_first
from flexarm.base.arguments import check_choice, check_count, check_kind, check_options
from flexarm.base.errors import (
    InputError,
    Problem,
    UnstableLoopWarning,
    public_call,
    shown,
    warn_caller,
)
from flexarm.control.contract.base import Controller, Reference, check_controller, check_reference
from flexarm.control.hardware.measurement import FloatArray
from flexarm.model import Hardware
from flexarm.planning.learning.added_torque import AddedTorque
from flexarm.planning.learning.bench import Bench, window_of
from flexarm.planning.learning.choice import check_choice_of_law
from flexarm.planning.learning.laws import Law
from flexarm.planning.learning.learned_motion import LearnedMotion
from flexarm.planning.learning.lifted import check_linear
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
    trials: int = 10,
    duration: float | None = None,
    interval: float | None = None,
    effort: float = 1e-6,
    change: float = 0.0,
    proportional: ArrayLike | None = None,
    derivative: ArrayLike = 0.0,
    lead: float = 0.0,
    cutoff: float | None = None,
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
    arm = check_kind("arm", arm, Arm)
    check_reference(reference)
    check_controller("controller", controller)
    check_choice("output", output, OUTPUTS)
    count = check_count("trials", trials)
    if trial is not None and not callable(trial):
        raise InputError(Problem("trial", "be a function of a controller", shown(trial)))
    own = {"plant": plant, "hardware": hardware, **options}
    given = [name for name, value in own.items() if value is not None]
    if trial is not None and given:
        raise InputError(Problem("trial", f"cannot be combined with {given[0]}"))
    if plant is not None:
        check_kind("plant", plant, Arm)
    if hardware is not None:
        check_kind("hardware", hardware, Hardware)
    check_options(options, _OPTIONS, "iterative_learning")
    check_linear(controller, arm, reference)
    window = window_of(arm, reference, controller, duration, interval)
    choice = check_choice_of_law(arm.joints, effort, change, proportional, derivative, lead, cutoff)
    bench = Bench(arm, reference, window, output, plant, hardware, trial, options)
    with one_warning() as bent:
        unchanged = AddedTorque(
            controller, np.zeros((window.intervals, arm.joints)), window.interval
        )
        P = bench.model(unchanged)
        law = choice.law(P, arm, reference, window, output)
        learned = _learn(bench, unchanged, law, P, count)
    warn_of_first(bent)
    return learned


def _learn(
    bench: Bench, controller: AddedTorque, law: Law, P: FloatArray, trials: int
) -> LearnedMotion:
    """Carry out the trials."""
    T = law.contraction(P)
    rate, bound = float(np.max(np.abs(np.linalg.eigvals(T)))), float(np.linalg.norm(T, 2))
    if rate >= 1.0:
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
    return LearnedMotion(
        controller,
        controller.interval,
        np.array(torques),
        np.array(errors),
        np.array(predicted),
        rate,
        bound,
        rate_of_change,
        bench.result,
    )
