"""Every integrator over a tenth of a second of an arm with all kinds of forces, against SciPy.

The runs have a few dozen steps, so that the kernels may also run as plain Python.
"""

from functools import cache

import numpy as np
import pytest
from integrator_runs import advance, double_pendulum, start
from scipy.integrate import solve_ivp

import flexarm as fa
from arm_states import state_array
from flexarm.arm.actions import Environment
from flexarm.integrate import INTEGRATORS
from flexarm.integrate.base import Drive, Status, System, Tolerance
from flexarm.kernels.layout import new_workspace, run_time_sizes
from flexarm.simulation.run.tolerance import tolerance_of

UNTIL, BREAK = 0.1, 0.04

#: Torques (2 pieces, 4, joints), N m / s^p, which jump at BREAK.
TORQUE = np.array(
    [
        [[3.0, -1.0], [40.0, 20.0], [-300.0, 200.0], [2e3, -3e3]],
        [[-2.0, 0.5], [10.0, -30.0], [100.0, 50.0], [-1e3, 2e3]],
    ]
)
#: Factors of the load, and accelerations of the base along x and y (m/s^2), over the same pieces.
FACTORS = np.array(
    [
        [[1.0, 2.0, -1.0], [5.0, -20.0, 30.0], [-50.0, 100.0, 0.0], [300.0, 0.0, 2e3]],
        [[-0.5, 1.0, 0.0], [8.0, 10.0, -20.0], [0.0, -80.0, 60.0], [-200.0, 500.0, 0.0]],
    ]
)
EDGES = np.array([0.0, BREAK, UNTIL])
LOAD = fa.Load(link=1, force=(4.0, -7.0), moment=0.6, station=0.5)


@cache
def arm():
    """Return two bending links with damping; joints with springs, damping, friction and distant
    stops."""
    limits = fa.JointLimits(lower=-3.0, upper=3.0, stiffness=50.0)
    return fa.Arm(
        links=[
            fa.Link(
                length=1.0,
                flexural_rigidity=4.0,
                mass_per_length=0.5,
                elements=1,
                damping=fa.ModalDamping(ratio=0.03),
            ),
            fa.Link(length=0.6, flexural_rigidity=3.0, mass_per_length=0.4, elements=1, modes=1),
        ],
        joints=[
            fa.Joint(hub_inertia=0.05, damping=0.3, limits=limits),
            fa.Joint(hub_inertia=0.02, mass=0.2, stiffness=6.0, rest_angle=0.3, damping=0.05),
        ],
        payload=fa.Payload(mass=0.3, inertia=0.01),
        gravity=(0.0, -9.81),
        theory="second_order",
    )


@cache
def start_state():
    q = arm().from_nodal([0.2, -0.9], [[[0.01, 0.02]], [[0.004, 0.01]]])
    qd = arm().from_nodal([0.4, -0.7], [[[0.05, -0.1]], [[0.02, 0.1]]])
    return np.stack([q, qd])


def polynomial(coefficients, t):
    piece = int(t >= BREAK)
    return (t - EDGES[piece]) ** np.arange(4) @ coefficients[piece]


@cache
def exact():
    """Return the motion by SciPy on ``Arm.forward_dynamics``, as a function of time."""
    n = arm().dof

    def slope(piece):
        def of(t, y):
            x = (t - EDGES[piece]) ** np.arange(4)
            factor, *base = x @ FACTORS[piece]
            force = factor * np.array(LOAD.force)
            load = fa.Load(link=1, force=force, moment=factor * LOAD.moment, station=0.5)
            torque = x @ TORQUE[piece]
            qdd = arm().forward_dynamics(
                y[:n], y[n:], torque, loads=[load], base_acceleration=np.array(base)
            )
            return np.concatenate([y[n:], qdd])

        return of

    runs, y = [], start_state().ravel()
    for piece in range(2):
        span = EDGES[piece : piece + 2]
        run = solve_ivp(slope(piece), span, y, "DOP853", rtol=1e-12, atol=1e-13, dense_output=True)
        runs.append(run.sol)
        y = run.y[:, -1]
    return lambda t: state_array(arm(), *runs[int(t >= BREAK)](t).reshape(2, n))


def driven_system(stops=()):
    constants = arm().assembly.constants
    loads = Environment([LOAD]).placed(arm())
    drive = Drive(
        EDGES,
        arm().padded_torque(TORQUE),
        np.sort([BREAK, *stops]),
        loads=loads,
        amplitude=loads.value.copy(),
        factor_breaks=EDGES,
        factor_coefficients=FACTORS,
    )
    return System(run_time_sizes(constants), constants, drive, new_workspace(constants))


def tolerance(allowed):
    return tolerance_of(arm(), state_array(arm(), *start_state()), allowed, allowed, 1.0, 1.0)


def error(found, t):
    """Return the largest error of a state; coordinates are converted to metres at the tip."""
    return float(np.max(np.abs(found - exact()(t)) / tolerance(1.0).unit))


def run_in_steps(name, count, times=()):
    """Take ``count`` equal steps to UNTIL; with step control, a stop ends each of them."""
    kind = INTEGRATORS[name]
    ends = np.arange(1, count) * (UNTIL / count)
    unit = tolerance(1.0)
    anything = Tolerance(1e30 if kind.adaptive else 1e-9, 0.0, unit.unit, unit.fastest)
    progress = start(arm(), start_state())
    ends = ends[np.abs(ends - BREAK) > 1e-9] if kind.adaptive else ()
    system = driven_system(ends)
    status, samples = advance(kind(step=UNTIL / count), system, anything, progress, UNTIL, times)
    assert status == Status.DONE
    assert progress.steps == count
    return progress, samples


#: Two numbers of steps in the range where the leading error dominates, multiples of 5 for BREAK,
#: and the allowed error with the second one, m at the tip: three times the error of the method, or
#: of its dense output. A wrong coefficient increases the error by orders of magnitude.
STEPS = {
    "rk4": (20, 40, 7e-5),
    "dormand_prince_8": (5, 10, 2.5e-6),
    "kennedy_carpenter_5": (15, 30, 7e-7),
    "cowell_4": (40, 80, 4e-6),
    "gauss_6": (10, 20, 3e-6),
    "generalized_alpha": (80, 160, 1.4e-3),
}


@pytest.mark.parametrize("name", INTEGRATORS)
def test_order_under_all_forces(name):
    first, second, allowed = STEPS[name]
    few, many = (error(run_in_steps(name, count)[0].state, UNTIL) for count in (first, second))
    assert many < allowed
    observed, order = np.log(few / many) / np.log(second / first), INTEGRATORS[name].order
    assert observed > order - 0.4  # a wrong formula loses at least one order


@pytest.mark.parametrize("name", INTEGRATORS)
def test_samples_inside_steps(name):
    times = np.array([0.0, 0.0031, 0.0172, 0.0391, BREAK, 0.0402, 0.0777, 0.0999, UNTIL])
    _, count, allowed = STEPS[name]
    progress, samples = run_in_steps(name, count, times)
    assert progress.sample == len(times)
    for sample, t in zip(samples, times, strict=True):
        assert error(sample, t) < allowed
    np.testing.assert_array_equal(samples[-1], progress.state)


@pytest.mark.parametrize("name", INTEGRATORS)
def test_single_steps_give_the_same_run(name):
    kind = INTEGRATORS[name]
    ends = []
    for most in (10**9, 1):
        progress = start(arm(), start_state())
        status, _ = advance(
            kind(step=0.01), driven_system(), tolerance(1e-4), progress, UNTIL, max_steps=most
        )
        assert status == Status.DONE
        ends.append((progress.state, progress.steps, progress.rejected))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    assert ends[0][1:] == ends[1][1:]


@pytest.mark.parametrize("name", [name for name, kind in INTEGRATORS.items() if kind.adaptive])
def test_step_control_after_a_long_first_step(name):
    """The first step is far too long and is repeated; afterwards few steps are rejected."""
    taken = []
    for allowed in (1e-5, 1e-8):
        progress = start(arm(), start_state())
        kind = INTEGRATORS[name]
        status, _ = advance(kind(step=UNTIL), driven_system(), tolerance(allowed), progress, UNTIL)
        assert status == Status.DONE
        # The sum of errors over about ten steps; that of a mode is relative to the largest mode.
        assert error(progress.state, UNTIL) < 100.0 * allowed
        assert 1 <= progress.rejected <= 8
        taken.append(progress.steps)
    # A thousandth of the error requires, at order p, 1000^(1/p) times as many steps.
    more = 1000.0 ** (1.0 / INTEGRATORS[name].order)
    assert 0.7 * more < taken[1] / taken[0] < 1.5 * more


def test_overdamped_mode_leaves_the_momentum_right():
    """Under a sudden torque of 0.5 N m the momentum about the joint is t / 2 after t seconds.

    ``cowell_4`` has a separate formula for such modes, which must start with the same momentum.
    """
    damping = fa.RayleighDamping(mass_coefficient=0.0, stiffness_coefficient=2e-3)
    rod = {"length": 1.0, "flexural_rigidity": 60.0, "mass_per_length": 0.5, "elements": 1}
    rotor = fa.Arm(links=[fa.Link(**rod, damping=damping)], joints=[fa.Joint(hub_inertia=0.1)])
    run = fa.simulate(
        rotor, 0.1, torque=lambda t: [0.5], integrator="cowell_4", step=5e-3, rate=100.0
    )
    q, qd = run.q.values, run.qd.values
    momentum = [rotor.mass_matrix(a)[0] @ b for a, b in zip(q, qd, strict=True)]
    assert abs(q[:, 1:]).max() > 1e-4  # the link bends
    # The first three steps are those of another method. Their effect on the mode decays within a
    # few steps, except for products of small deflections and rates.
    np.testing.assert_allclose(momentum[5:], 0.5 * run.time.values[5:], rtol=0, atol=2e-7)


def test_motion_too_fast_for_predicted_rates_is_stopped():
    """``cowell_4`` predicts posture and rates, and checks the prediction every 32 steps."""
    pendulum, (q, _) = double_pendulum()
    settings = {"initial": q, "initial_rate": [9.0, -12.0], "integrator": "cowell_4"}
    with pytest.raises(fa.SimulationError, match="the step is too long for this motion"):
        fa.simulate(pendulum, 1.5, step=0.02, **settings)
    fa.simulate(pendulum, 0.1, step=0.002, **settings)
