"""Derivatives of the last state of a run by complex steps through the integrator."""

from itertools import pairwise

import numpy as np

from flexarm.arm.actions.environment import Environment
from flexarm.kernels.layout import ArmConstants
from flexarm.linear.step_derivatives.parameters import constants_at
from flexarm.linear.step_derivatives.step_jacobian import stepper_of
from flexarm.model.paths import number_at
from flexarm.simulation.calls.preparation import run_options
from flexarm.simulation.histories.piecewise import PiecewiseCubic
from flexarm.simulation.run.progress import Meter

STEP = 1e-30


def options(duration, **more):
    plain = {
        "rate": 1000.0, "step": None, "rtol": 1e-7, "atol": None, "breaks": (),
        "torque_interpolation": "cubic", "integrator": "auto", "stations": 0, "specialized": None,
    }  # fmt: skip
    return run_options(duration, **(plain | more))


def step_ends(arm, state, torque, duration, **more):
    """Return the ends of the steps of ``simulate`` under a constant torque."""
    run = options(duration, **more).new_run(
        arm, state.copy(), Environment.of(arm), None, Meter("", False)
    )
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
        x = stepper_of(arm, method, end - start).take(x, arm.padded_torque(torque), constants)
    return x.imag / STEP
