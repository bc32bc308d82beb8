"""The numbered rules of ``flexarm.integrate.base``, for every integrator of the registry."""

import dataclasses
import inspect
from functools import cache

import numpy as np
import pytest
from integrator_runs import (
    PROBLEMS,
    SMOOTH,
    advance,
    bang_bang,
    double_pendulum,
    equal_steps,
    flexible_arm,
    make_system,
    reference,
    start,
    tolerance,
)

import flexarm as fa
from arm_states import state_array
from constant_torques import parabolas
from flexarm.base.references import citation
from flexarm.integrate import INTEGRATORS, Integrator
from flexarm.integrate import status as codes
from flexarm.integrate.base import Progress, Status
from flexarm.kernels.compilation.cache import undecorated

every = pytest.mark.parametrize("name", INTEGRATORS)
each_problem = pytest.mark.parametrize("problem", PROBLEMS)


@cache
def exact(problem):
    arm, state = PROBLEMS[problem]()
    return reference(arm, state)


def make(name, allowed=1e-8):
    """Return an integrator that reaches this accuracy on the problems here."""
    integrator = INTEGRATORS[name]()
    if integrator.adaptive:
        return integrator
    return INTEGRATORS[name](step=2e-4 if integrator.order > 2 else 1e-5)


# The class itself --------------------------------------------------------------------------------


@every
def test_class_is_a_frozen_dataclass_with_name_and_order(name):
    kind = INTEGRATORS[name]
    assert issubclass(kind, Integrator)
    assert len(inspect.signature(undecorated(kind.stepper)).parameters) == 6
    assert kind.name == name
    assert kind.order >= 1
    assert isinstance(kind.adaptive, bool)
    assert inspect.getdoc(kind)
    assert dataclasses.is_dataclass(kind)
    assert kind() == kind()  # equal parameters make equal methods
    with pytest.raises(dataclasses.FrozenInstanceError):
        kind().step = 1.0


@every
def test_reference_can_be_cited(name):
    arm, state = double_pendulum()
    result = fa.simulate(arm, 0.01, initial=state[0], integrator=name, rate=100.0)
    assert INTEGRATORS[name].reference
    text = citation(result)
    for key in INTEGRATORS[name].reference:
        assert f"{{{key}," in text


@every
def test_contacts_are_simulated_or_rejected(name):
    """A rod of 1 kg m^2 hits a spring at a radius of 1 m: contact lasts half a period."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=3.0, flexible=False)])
    contact = fa.Contact(fa.Wall((1.0, 0.0), (0.0, -1.0)), stiffness=1e4)
    throw = {"initial": [-0.1], "initial_rate": [1.0], "contacts": [contact], "integrator": name}
    if not INTEGRATORS[name].follows_contacts:
        with pytest.raises(fa.InputError, match="for an arm with contacts"):
            fa.simulate(arm, 0.2, **throw)
        return
    result = fa.simulate(arm, 0.2, **throw)
    assert "HuntCrossley1975" in citation(result)
    back = 0.1 - 0.2 + np.pi / 100.0  # it returns along the same path
    # Arc of 0.1 m; a fixed step of half a radian of the contact vibration has a smaller error.
    assert float(result.joint_angle[-1, 0]) == pytest.approx(back, abs=1e-3)
    assert float(result.joint_rate[-1, 0]) == pytest.approx(-1.0, abs=1e-2)


# Rule 1: integration proceeds to the end, in one call or in many ---------------------------------


@every
@each_problem
def test_advance_reaches_the_end_and_counts_its_work(name, problem):
    arm, state = PROBLEMS[problem]()
    progress = start(arm, state)
    times = np.linspace(0.0, 0.7, 8)
    status, samples = advance(
        make(name), make_system(arm), tolerance(arm, state, 1e-8), progress, 0.7, times
    )
    assert status == Status.DONE
    assert progress.time == 0.7
    assert progress.sample == len(times)
    assert np.all(np.isfinite(samples))
    assert 0 < progress.steps < progress.evaluations
    np.testing.assert_array_equal(samples[0], start(arm, state).state)
    np.testing.assert_array_equal(samples[-1], progress.state)
    # A call for a time that is already reached changes nothing.
    before = dataclasses.replace(progress, state=progress.state.copy())
    status, _ = advance(
        make(name), make_system(arm), tolerance(arm, state, 1e-8), progress, 0.7, times
    )
    assert status == Status.DONE
    assert (progress.time, progress.steps) == (before.time, before.steps)
    np.testing.assert_array_equal(progress.state, before.state)


@every
@each_problem
def test_pauses_do_not_change_the_run(name, problem):
    """A progress bar divides calls at arbitrary times."""
    arm, state = PROBLEMS[problem]()
    times = np.linspace(0.0, 1.0, 23)
    runs = []
    for max_steps in (10**9, 7, 1):
        progress = start(arm, state)
        # The first step is so long that it is rejected, so that pauses also follow rejections.
        integrator = INTEGRATORS[name](step=0.3 if INTEGRATORS[name].adaptive else 1e-3)
        _, samples = advance(
            integrator,
            make_system(arm),
            tolerance(arm, state, 1e-8),
            progress,
            1.0,
            times,
            max_steps=max_steps,
        )
        runs.append((samples, progress))
    whole, at_once = runs[0]
    for samples, progress in runs[1:]:
        np.testing.assert_array_equal(samples, whole)
        assert progress.steps == at_once.steps
        assert progress.rejected == at_once.rejected


@every
def test_advance_pauses_after_the_given_number_of_steps(name):
    arm, state = double_pendulum()
    progress = start(arm, state)
    samples = np.zeros((0, *progress.state.shape))
    status = make(name).advance(
        make_system(arm), tolerance(arm, state, 1e-8), progress, 1.0, np.zeros(0), samples, 3
    )
    assert status == Status.PAUSED
    assert progress.steps + progress.rejected == 3
    assert 0.0 <= progress.time < 1.0


# Rule 2: samples at exactly the requested times --------------------------------------------------


@every
@each_problem
def test_samples_are_accurate_at_the_requested_times(name, problem):
    arm, state = PROBLEMS[problem]()
    rng = np.random.default_rng(1)
    times = np.sort(np.concatenate([[0.0, 1e-9, 0.25, 0.25 + 1e-12, 1.0], rng.random(40)]))
    _, samples = advance(
        make(name),
        make_system(arm, stops=[0.25, 0.6]),
        tolerance(arm, state, 1e-9),
        start(arm, state),
        1.0,
        times,
    )
    wanted = np.array([exact(problem)(t) for t in times])
    # The tolerance per step, over some hundred steps, times the amplification by the motion.
    np.testing.assert_allclose(samples, wanted, rtol=0, atol=3e-6)


@every
def test_samples_between_steps_have_third_order_at_least(name):
    arm, state = double_pendulum()
    middles = np.array([0.13, 0.37, 0.61, 0.93])
    wanted = np.array([exact("double pendulum")(t) for t in middles])
    order = INTEGRATORS[name].order
    errors, counts = [], step_counts(name, 16, 600)
    for count in counts:
        _, samples = equal_steps(INTEGRATORS[name], arm, state, int(count), middles)
        errors.append(abs(samples - wanted).max())
    # The slope approaches the order from both sides. Samples are not more accurate than the steps.
    assert observed_order(counts, np.array(errors)) > min(2.8, order - 0.2)


# Rules 3 and 4: stops --------------------------------------------------------------------------


@every
def test_steps_end_at_stops_with_the_torque_of_the_correct_side(name):
    arm, edges, torque, coefficients = bang_bang()
    system = make_system(arm, edges, coefficients, stops=edges[1:-1])
    times = np.array([0.05, 0.1234, 0.3, 0.5, 0.500005, 0.50001, 0.7, 0.87, 0.95, 1.0])
    state = np.zeros((2, 1))
    # Steps of a tenth hardly ever end at an edge by chance.
    integrator = INTEGRATORS[name](step=0.1)
    progress = start(arm, state)
    _, samples = advance(integrator, system, tolerance(arm, state, 1e-3), progress, 1.0, times)
    wanted = np.array([parabolas(edges, torque, t) for t in times])  # the inertia is 1
    # Rounding of a few dozen steps; a step across an edge has an error of 1e-3.
    np.testing.assert_allclose(samples[:, :, 0, 0], wanted, rtol=0, atol=1e-14)


@every
def test_stops_without_a_jump_do_not_change_the_result(name):
    arm, state = flexible_arm()
    allowed = tolerance(arm, state, 1e-10)
    # Stops at the start, at the end, twice the same, closer than any step, and beyond the end.
    stops = [0.0, 0.3, 0.3, 0.3 + 1e-13, 0.6, 1.0, 2.0]
    progress = start(arm, state)
    status, _ = advance(make(name), make_system(arm, stops=stops), allowed, progress, 1.0)
    assert status == Status.DONE
    wanted = exact("flexible arm")(1.0)
    np.testing.assert_allclose(progress.state, wanted, rtol=0, atol=1e-6)


# Rule 5: failures are reported -------------------------------------------------------------------


@every
def test_nan_torque_ends_the_run_before_its_time(name):
    """From 0.4 s on the torque is NaN."""
    arm, state = double_pendulum()
    coefficients = SMOOTH.copy()
    coefficients[1] = np.nan
    system = make_system(arm, [0.0, 0.4, 1.0], coefficients, stops=[0.4])
    times = np.linspace(0.0, 1.0, 101)
    progress = start(arm, state)
    status, samples = advance(make(name), system, tolerance(arm, state, 1e-8), progress, 1.0, times)
    assert status == Status.NOT_FINITE
    assert status.sentence
    assert progress.time == pytest.approx(0.4, abs=1e-12)
    assert np.all(np.isfinite(progress.state))
    assert progress.sample == 41  # samples up to 0.4 s only
    assert np.all(np.isfinite(samples[:41]))
    wanted = exact("double pendulum")(progress.time)
    np.testing.assert_allclose(progress.state, wanted, rtol=0, atol=1e-5)


@every
def test_unbounded_torque_never_gives_a_non_finite_state(name):
    arm, state = double_pendulum()
    coefficients = np.zeros((1, 4, 2))
    coefficients[0, 3] = 1e300
    times = np.linspace(0.0, 1.0, 11)
    progress = start(arm, state)
    status, samples = advance(
        make(name),
        make_system(arm, [0.0, 1.0], coefficients),
        tolerance(arm, state, 1e-8),
        progress,
        1.0,
        times,
    )
    assert status in (Status.NOT_FINITE, Status.STEP_UNDERFLOW, Status.NOT_CONVERGED)
    assert progress.time < 1.0
    assert np.all(np.isfinite(progress.state))
    assert np.all(np.isfinite(samples[: progress.sample]))


@pytest.mark.parametrize("name", [n for n, kind in INTEGRATORS.items() if not kind.adaptive])
def test_too_long_a_fixed_step_is_reported(name):
    arm, state = flexible_arm()
    allowed = tolerance(arm, state, 1e-8)
    progress = start(arm, state)
    integrator = INTEGRATORS[name](step=20.0 / allowed.fastest)
    status, _ = advance(integrator, make_system(arm), allowed, progress, 50.0)
    allowed_ends = Status.NOT_FINITE, Status.DIVERGED, Status.INERTIA_LOST, Status.NOT_CONVERGED
    assert status in allowed_ends
    assert np.all(np.isfinite(progress.state))


@pytest.mark.parametrize("name", [n for n, kind in INTEGRATORS.items() if kind.adaptive])
def test_accuracy_beyond_double_precision_is_rejected(name):
    arm, state = double_pendulum()
    allowed = tolerance(arm, state, 1e-30)
    progress = start(arm, state)
    status, _ = advance(INTEGRATORS[name](), make_system(arm), allowed, progress, 1.0)
    assert status == Status.STEP_UNDERFLOW
    assert np.all(np.isfinite(progress.state))


@pytest.mark.parametrize("status", Status)
def test_every_status_has_a_message(status):
    assert status.sentence.endswith(".")
    assert getattr(codes, status.name) == status  # statuses that kernels return


# Rule 6: order of convergence --------------------------------------------------------------------


def step_counts(name, fewest, most):
    """Return numbers of equal steps in a second; a method of order 2 needs a hundred times as
    many."""
    more = 1 if INTEGRATORS[name].order > 2 else 100
    return np.unique(np.geomspace(fewest * more, most * more, 24).astype(int))


def observed_order(counts, errors):
    """Return the slope of error against step at the four smallest steps with errors above
    rounding."""
    seen = np.flatnonzero((errors > 2e-12) & (errors < 1e-4))[-4:]
    assert seen.size == 4, errors
    return -np.polyfit(np.log(counts[seen]), np.log(errors[seen]), 1)[0]


@pytest.mark.thorough_cases("double pendulum-generalized_alpha", "flexible arm-generalized_alpha")
@every
@each_problem
def test_observed_order_equals_the_stated_order(name, problem):
    arm, state = PROBLEMS[problem]()
    # Steps start at 0.8 radians of the fastest vibration, because several methods are unstable at
    # 1.4.
    counts = step_counts(name, 40, 2000)
    wanted = exact(problem)(1.0)
    errors = [
        abs(equal_steps(INTEGRATORS[name], arm, state, int(count))[0].state - wanted).max()
        for count in counts
    ]
    order = observed_order(counts, np.array(errors))
    # Where the leading error is small by chance, the next order appears: about one more. Less than
    # the stated order is an error.
    claimed = INTEGRATORS[name].order
    assert claimed - 0.2 < order < claimed + 1.2


@pytest.mark.parametrize("name", [n for n, kind in INTEGRATORS.items() if kind.adaptive])
@each_problem
def test_error_is_proportional_to_the_tolerance(name, problem):
    """A tolerance of a thousand times the size gives about a thousand times the error."""
    arm, state = PROBLEMS[problem]()
    wanted = exact(problem)(1.0)
    allowed = np.array([1e-4, 1e-6, 1e-8, 1e-10])
    errors, steps = [], []
    for level in allowed:
        progress = start(arm, state)
        advance(INTEGRATORS[name](), make_system(arm), tolerance(arm, state, level), progress, 1.0)
        errors.append(abs(progress.state - wanted).max())
        steps.append(progress.steps)
    slope = np.polyfit(np.log(allowed), np.log(errors), 1)[0]
    assert 0.7 < slope < 1.4
    # rates in rad/s of vibrations have the largest errors
    assert np.all(np.array(errors) < 1e4 * allowed)
    assert steps == sorted(steps)


# Rule 7: no allocation per step ------------------------------------------------------------------


def arrays_of(record):
    """Return address and shape of every array in nested records."""
    if isinstance(record, tuple):
        return [found for part in record for found in arrays_of(part)]
    return [(id(record), record.shape)] if isinstance(record, np.ndarray) else []


@every
def test_long_runs_use_no_more_objects_than_short_ones(name):
    """Arrays of a run are in ``progress.memory`` and in the record of the method, and stay the
    same. The samples are those of the caller."""
    arm, state = flexible_arm()
    progress = start(arm, state)

    def arrays():
        own = progress.memory._replace(sample_times=None, samples=None)
        return arrays_of((own, progress.method))

    system, allowed = make_system(arm), tolerance(arm, state, 1e-6)
    advance(make(name), system, allowed, progress, 0.1)
    memory, kept = arrays(), id(progress.state)
    assert len(memory) >= 8
    advance(make(name), system, allowed, progress, 1.0)
    assert arrays() == memory
    assert id(progress.state) == kept


def test_progress_may_start_at_any_time():
    """The time of the torque does not begin at the start of the run."""
    arm, state = double_pendulum()
    halfway = exact("double pendulum")(0.5)
    for name in INTEGRATORS:
        progress = Progress(0.5, halfway.copy(), 0.0)
        advance(make(name), make_system(arm), tolerance(arm, state, 1e-10), progress, 1.0)
        wanted = exact("double pendulum")(1.0)
        np.testing.assert_allclose(progress.state, wanted, rtol=0, atol=1e-7)
    assert state_array(arm, *state).shape == halfway.shape
