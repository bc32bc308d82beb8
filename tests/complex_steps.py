"""Derivatives of the last state of a run by complex steps through the integrator."""

from itertools import pairwise

import numpy as np

import flexarm as fa
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.parameters import constants_at
from flexarm.linear.step_derivatives.sampled_step import stepper_of
from flexarm.model.paths import number_at
from flexarm.simulation.calls.preparation import Situation
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.progress import Meter

STEP = 1e-30


def step_ends(arm, state, torque, duration, **more):
    """Return the ends of the steps of ``simulate`` under a constant torque."""
    q, qd = arm.unpadded(state)
    settings = fa.RunSettings(**more)
    situation = Situation(arm=arm, duration=duration, settings=settings, initial=q, initial_rate=qd)
    run = situation.new_run(Meter("", False))
    system, times = run.system(PiecewiseCubic.constant(torque)), [0.0]
    while times[-1] < duration:
        run.integrator.advance(
            system, run.tolerance, run.progress, duration, np.zeros(0), run.samples[:0], 1
        )
        if run.progress.time > times[-1]:
            times.append(run.progress.time)
    return times


def by_complex_steps(arm, method, times, q, qd, torque, path):
    """Return the derivative of the last state [q, qd] of a run by a parameter."""
    x, constants = np.concatenate([q, qd]).astype(complex), arm.assembly.constants
    if path.startswith("initial"):
        x[int(path[:-1].partition("[")[2]) + arm.dof * path.startswith("initial_rate")] += 1j * STEP
    else:
        value = number_at("", arm.spec, path)
        constants = constants_at(arm, {path: value + 1j * STEP}, complex)[0]
    constants = ArmConstants(*(array.astype(complex) for array in constants))
    for start, end in pairwise(times):
        x = stepper_of(arm, method, end - start)(x, arm.padded_torque(torque), constants)
    return x.imag / STEP
