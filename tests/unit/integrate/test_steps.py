"""Functions that the steppers share, one at a time, as plain Python."""

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate import Cowell4
from flexarm.integrate.base import Drive, System
from flexarm.integrate.memory import COUNT, END, LENGTH, new_memory
from flexarm.integrate.multistep.resolved_modes import longest_step
from flexarm.integrate.status import DIVERGED, DONE, NOT_FINITE
from flexarm.integrate.steps import begin_span, followed, next_stop
from flexarm.kernels.compilation.cache import undecorated
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.simulation.run.tolerance import tolerance_of

ROD = {"length": 5.0, "flexural_rigidity": 900.0, "mass_per_length": 0.6, "elements": 1}


@pytest.mark.parametrize(("until", "expected"), [(0.3, 0.3), (1.0, 0.5), (9.0, 0.5)])
def test_next_stop_is_after_the_time(until, expected):
    stops = np.array([0.0, 0.25, 0.5, 2.0])
    assert undecorated(next_stop)(stops, 0.25, until) == expected
    assert undecorated(next_stop)(stops[:0], 0.25, until) == until


def test_span_has_equal_steps_no_longer_than_allowed():
    clock = np.zeros(32)
    for step, count in ((0.1, 5), (0.09, 6), (0.5, 1), (3.0, 1), (0.1 * (1.0 - 1e-12), 5)):
        undecorated(begin_span)(np.array([0.7]), 0.2, 1.0, step, clock)
        assert clock[END] == 0.7
        assert clock[COUNT] == count
        assert clock[LENGTH] == pytest.approx(0.5 / count, rel=1e-14)


@pytest.mark.parametrize("length", [5.0, 0.2])
def test_fixed_step_ends_at_a_plausible_state(length):
    """Deflections of up to a hundred times the reach, half a turn of a joint in a step."""
    arm = fa.Arm(links=[fa.Link(**{**ROD, "length": length})])
    unit = tolerance_of(arm, np.zeros((2, 1, 3)), 1e-6, 1e-6, 1.0, 1.0)
    sizes, check = run_time_sizes(arm.assembly.constants), undecorated(followed)

    def status(angle=0.0, rate=0.0, deflection=0.0, h=0.1):
        state = np.zeros((2, 1, 3))
        state[:, 0, 0] = angle, rate
        state[0, 0, 2] = deflection * unit.unit[0, 0, 2]  # metres at the tip
        with np.errstate(invalid="ignore"):  # compiled code does not warn either
            return check(sizes, unit, state, h)

    assert status(angle=1e3, rate=0.99 * np.pi / 0.1, deflection=-99.0 * length) == DONE
    assert status(deflection=101.0 * length) == DIVERGED
    assert status(deflection=-101.0 * length) == DIVERGED
    assert status(rate=-1.01 * np.pi / 0.1) == DIVERGED
    for bad in (np.nan, np.inf):
        assert status(angle=bad) == status(rate=bad) == status(deflection=bad) == NOT_FINITE


def test_stable_steps_follow_from_frequency_and_damping():
    """A rod of 1 kg m^2 on a spring:

    Numerov's formula is stable up to h^2 k = 5, with a margin; (I.8).
    """
    rod = fa.Link(length=1.0, mass_per_length=3.0, flexible=False)
    arm = fa.Arm(links=[rod], joints=[fa.Joint(stiffness=20.0, damping=4.0)])
    constants = arm.assembly.constants
    span = np.array([0.0, 1.0])
    drive = Drive(
        span,
        np.zeros((1, 4, 1)),
        np.zeros(0),
        no_loads(constants),
        np.zeros((0, 3)),
        span,
        np.zeros((1, 4, 0)),
    )
    system = System(run_time_sizes(constants), constants, drive, new_workspace(constants))
    state = np.array([[[0.3]], [[2.0]]])
    record, memory = Cowell4().record(constants, state), new_memory(state, 1.0)
    many = 1e4  # s: so many steps that restarts do not matter
    found = undecorated(longest_step)(
        system, state, memory.new, record.start.known, memory.torque, record.stiff,
        record.bounds, 1.0, many,
    )  # fmt: skip
    np.testing.assert_allclose(record.bounds[:2], [20.0, 4.0], rtol=1e-12)
    assert found**2 * 20.0 / 5.0 + found * 4.0 / 1.3 == pytest.approx(1.0, rel=1e-12)
