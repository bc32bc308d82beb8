"""Small systems to integrate, and simple drivers of an integrator's ``advance``."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

import flexarm as fa
from arm_states import state_array
from flexarm.integrate.base import Drive, Progress, Status, System, Tolerance
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.simulation.run.tolerance import tolerance_of

#: Torque in cubic pieces on two joints, smooth at the break at 0.5 s.
BREAKS = np.array([0.0, 0.5, 1.0])
_FIRST = np.array([[0.6, -0.3], [1.0, 0.5], [-2.0, 0.4], [1.5, -0.8]])


def _shifted(cubic: np.ndarray, by: float) -> np.ndarray:
    """Return the coefficients of the same cubic about another origin."""
    c0, c1, c2, c3 = cubic
    return np.array(
        [
            c0 + by * (c1 + by * (c2 + by * c3)),
            c1 + by * (2 * c2 + 3 * by * c3),
            c2 + 3 * by * c3,
            c3,
        ]
    )


SMOOTH = np.stack([_FIRST, _shifted(_FIRST, 0.5)])


def double_pendulum() -> tuple[fa.Arm, np.ndarray]:
    """Return two rigid links that swing under gravity, and their state (2, dof)."""
    links = [
        fa.Link(length=0.8, mass_per_length=1.0, flexible=False),
        fa.Link(length=0.5, mass_per_length=0.7, flexible=False),
    ]
    arm = fa.Arm(links=links, gravity=(0.0, -9.81))
    return arm, np.array([[-1.0, 0.6], [0.3, -0.4]])


def flexible_arm() -> tuple[fa.Arm, np.ndarray]:
    """Return two soft, damped links, bent and turning; their vibrations reach 33 rad/s."""
    links = [
        fa.Link(length=1.0, flexural_rigidity=1.0, mass_per_length=0.5, elements=1),
        fa.Link(
            length=0.6,
            flexural_rigidity=0.4,
            mass_per_length=0.4,
            elements=1,
            modes=1,
            damping=fa.ModalDamping(ratio=0.02),
        ),
    ]
    joints = [fa.Joint(hub_inertia=0.05), fa.Joint(hub_inertia=0.02, mass=0.2)]
    payload = fa.Payload(mass=0.3, inertia=0.01)
    arm = fa.Arm(links=links, joints=joints, payload=payload, theory="second_order")
    q = arm.from_nodal([0.2, -0.9], [[[0.01, 0.02]], [[0.001, 0.0025]]])
    return arm, np.stack([q, arm.rest([0.4, -0.7])])


PROBLEMS = {"double pendulum": double_pendulum, "flexible arm": flexible_arm}


def make_system(
    arm: fa.Arm,
    breaks: Any = BREAKS,
    coefficients: Any = SMOOTH,
    stops: Any = (),
) -> System:
    """Return the arm under a torque in pieces (pieces, 4, joints)."""
    constants = arm.assembly.constants
    drive = Drive(
        np.asarray(breaks, dtype=float),
        arm.padded_torque(np.asarray(coefficients, dtype=float)),
        np.asarray(stops, dtype=float),
        loads=no_loads(constants),
        amplitude=np.zeros((0, 3)),
        factor_breaks=np.array([0.0, 1.0]),
        factor_coefficients=np.zeros((1, 4, 0)),
    )
    return System(run_time_sizes(constants), constants, drive, new_workspace(constants))


def start(arm: fa.Arm, state: np.ndarray) -> Progress:
    return Progress(0.0, state_array(arm, *state), 0.0)


def tolerance(arm: fa.Arm, state: np.ndarray, allowed: float) -> Tolerance:
    return tolerance_of(arm, state_array(arm, *state), allowed, allowed, 1.0, 1.0)


def advance(
    integrator: Any,
    system: System,
    allowed: Tolerance,
    progress: Progress,
    until: float,
    times: Any = (),
    max_steps: int = 10**9,
) -> tuple[Status, np.ndarray]:
    """Integrate to a time through all pauses; return the last status and samples (times, 2, n, 1 +
    m)."""
    times = np.asarray(times, dtype=float)
    samples = np.full((len(times), *progress.state.shape), np.nan)
    status = Status.PAUSED
    while status == Status.PAUSED:
        status = integrator.advance(system, allowed, progress, until, times, samples, max_steps)
    return status, samples


def equal_steps(integrator_type: Any, arm: fa.Arm, state: np.ndarray, count: int, times: Any = ()):
    """Integrate over 1 s in ``count`` equal steps, with or without step control.

    With step control every end of a step is a stop, and the tolerance accepts every step.
    """
    ends = np.arange(1, count + 1) / count
    system = make_system(arm, stops=ends[:-1] if integrator_type.adaptive else ())
    unit = tolerance(arm, state, 1.0)
    anything = Tolerance(1e30, 0.0, unit.unit, unit.fastest)
    progress = start(arm, state)
    status, samples = advance(
        integrator_type(step=1.0 / count), system, anything, progress, 1.0, times
    )
    assert status == Status.DONE
    assert progress.steps == count
    return progress, samples


def reference(arm: fa.Arm, state: np.ndarray, until: float = 1.0):
    """Return the motion under SMOOTH as a function of time, by SciPy on
    ``Arm.forward_dynamics``."""
    n = arm.dof

    def slope(t, y):
        torque = t ** np.arange(4) @ _FIRST
        return np.concatenate([y[n:], arm.forward_dynamics(y[:n], y[n:], torque)])

    run = solve_ivp(
        slope, (0.0, until), state.ravel(), "DOP853", rtol=3e-14, atol=1e-15, dense_output=True
    )
    return lambda t: state_array(arm, *run.sol(t).reshape(2, n))


def bang_bang():
    """Return a rigid link under a piecewise constant torque; all methods are exact on the
    parabolas."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=3.0, flexible=False)])
    edges = np.array([0.0, 0.1234, 0.5, 0.50001, 0.87, 1.0])
    torque = np.array([1.0, -2.0, 5.0, 0.0, -3.0])
    coefficients = np.zeros((5, 4, 1))
    coefficients[:, 0, 0] = torque
    return arm, edges, torque, coefficients
