"""Linear designs whose model has the motors and instruments: delays, lag and filtered rates."""

import warnings

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import flexarm as fa
from arms import chain
from flexarm.cases.scenario.scenario import prepare
from flexarm.control.contract.law_program import program_of
from flexarm.model import Scenario
from flexarm.model.checks import checked_arguments

POSTURE, TICK = [0.3], 1e-3
LAG, CUTOFF = 1.7e-3, 90.0
#: Motors that are late by a sample and a half and lag; gauges that are late by two samples.
LATE = fa.Hardware(
    instruments=[
        fa.Instrument("joint_angle", rate_cutoff=CUTOFF),
        fa.Instrument("strain", delay=2 * TICK),
    ],
    motors=fa.Motors(delay=1.5 * TICK, time_constant=LAG),
)
NOISE = {"joint_angle": 1e-4, "joint_rate": 1e-2, "strain": 2e-5}
REQUIRED = {
    "acceptable": {"joint_angle": 0.01, "joint_rate": 0.2},
    "acceptable_torque": 2.0,
    "disturbance": {"torque": 0.2},
}


@pytest.fixture(scope="module")
def arm():
    rod = {"flexural_rigidity": 20.0, "mass_per_length": 0.5, "elements": 1, "damping": 0.01}
    more = {"gauge": (0.02, 0.004), "payload": 0.1, "gravity": (0.0, -9.81)}
    return chain([0.8], [0.05], **rod, **more)


def sampled(A, B, time):
    """Return A and B of a zero-order hold, from the exponential."""
    n, m = B.shape
    whole = expm(np.block([[A, B], [np.zeros((m, n + m))]]) * time)
    return whole[:n, :n], whole[:n, n:]


def written_out(arm):
    """Return the arm with LATE, one state after another: A, B, C, and the arm's outputs.

    States: arm, acting torque, the last two requests, the last angle, the filtered rate, and the
    last two strains. The filter is Tustin's rule for s / (1 + s / (2 pi cutoff)).
    """
    outputs = "joint_angle", "joint_rate", "strain"
    model = fa.linearize(arm, fa.equilibrium(arm, POSTURE), outputs=outputs)
    n, size = len(model.A), len(model.A) + 7
    angle, rate, strain = model.C
    A_lag = np.block([[model.A, model.B], [np.zeros((1, n)), -np.eye(1) / LAG]])
    B_lag = np.append(np.zeros(n), 1.0 / LAG)[:, None]
    half, push = sampled(A_lag, B_lag, 0.5 * TICK)
    A, B = np.zeros((size, size)), np.zeros((size, 1))
    # The request of two samples ago acts in the first half of the sample, the last one then.
    A[: n + 1, : n + 1] = half @ half
    A[: n + 1, n + 2], A[: n + 1, n + 1] = (half @ push)[:, 0], push[:, 0]
    B[n + 1], A[n + 2, n + 1] = 1.0, 1.0
    A[n + 3, :n] = angle
    slope, keep = 2.0 / TICK, 2.0 * np.pi * CUTOFF
    # rate = keep * slope / (keep + slope) (angle - last) - (keep - slope) / (keep + slope) rate
    gain = keep * slope / (keep + slope)
    filtered = np.zeros(size)
    filtered[:n], filtered[n + 3] = gain * angle, -gain
    filtered[n + 4] = (slope - keep) / (slope + keep)
    A[n + 4] = filtered
    A[n + 5, :n], A[n + 6, n + 5] = strain, 1.0
    C = np.zeros((3, size))
    C[0, :n], C[1], C[2, n + 6] = angle, filtered, 1.0
    _, disturbed = sampled(model.A, model.B, TICK)
    return A, B, C, np.vstack([angle / 0.01, rate / 0.2]), disturbed


def test_poles_are_those_of_the_regulator_and_of_the_filter_written_out(arm):
    A, B, C, weighted, disturbed = written_out(arm)
    n, size = weighted.shape[1], len(A)
    Q, W = np.zeros((2, size, size))
    Q[:n, :n], R = weighted.T @ weighted, np.eye(1) / 2.0**2
    P = solve_discrete_are(A, B, Q, R)
    regulated = A - B @ np.linalg.solve(R + B.T @ P @ B, B.T @ P @ A)
    W[:n, :n], V = 0.2**2 * disturbed @ disturbed.T, np.diag(np.square(list(NOISE.values())))
    S = solve_discrete_are(A.T, C.T, W, V)
    filtered = A - A @ S @ C.T @ np.linalg.solve(C @ S @ C.T + V, C)
    law = fa.LQG(arm, POSTURE, measured=NOISE, hardware=LATE, **REQUIRED)
    z = np.concatenate([np.linalg.eigvals(regulated), np.linalg.eigvals(filtered)])
    # Poles near zero, of delays, are computed to a root of the rounding error.
    expected = np.log(z[np.abs(z) > 0.3]) / TICK
    expected = expected[np.argsort(-expected.real)]
    # The states of the arm and of the motors, and those of the filter that decay.
    assert len(expected) > n
    found = law.loop_poles()
    for pole in expected:
        assert np.abs(found - pole).min() < 1e-4 * abs(pole)
    assert found[0].real == pytest.approx(expected[0].real, rel=1e-5)


@pytest.mark.parametrize(
    "make",
    [
        fa.LQG,
        fa.Composite,
        fa.LoopShaping,
        lambda *args, **given: fa.MPC(*args, torque_limit=1e3, sample_time=TICK, **given),
    ],
    ids=["lqg", "composite", "loop_shaping", "mpc"],
)
def test_loops_are_more_robust_than_without_and_with_a_delay(arm, make):
    """The delay is that of the loop, to whole samples: the other way to design for a drive."""
    designs = {"hardware": make(arm, POSTURE, hardware=LATE), "exact": make(arm, POSTURE)}
    if designs["exact"].name != "mpc":
        late = 1.5 * TICK + LAG + 2 * TICK * (designs["exact"].name != "loop_shaping")
        designs["delay"] = make(arm, POSTURE, delay=late)
    margins = {
        name: fa.loop_margins(law, arm, [POSTURE], hardware=LATE) for name, law in designs.items()
    }
    disk = {name: found.disk_margin.item() for name, found in margins.items()}
    assert margins["hardware"].growth.item() < 0.0
    assert disk.pop("hardware") > 1.1 * max(disk.values())


@pytest.mark.parametrize("kind", [fa.LQG, fa.Composite])
def test_hardware_with_whole_samples_of_delay_is_the_delay(arm, kind):
    hardware = fa.Hardware(motors=fa.Motors(delay=3 * TICK))
    disk = [
        fa.loop_margins(law, arm, [POSTURE], hardware=hardware).disk_margin.item()
        for law in (
            kind(arm, POSTURE, delay=3 * TICK),
            kind(arm, POSTURE, hardware=hardware),
        )
    ]
    assert disk[1] == pytest.approx(disk[0], rel=1e-6)


@pytest.mark.filterwarnings("ignore:the tip rests:flexarm.AccuracyWarning")  # rigid angles
def test_simulated_vibration_decays_as_the_poles_say(arm):
    law = fa.LQG(arm, POSTURE, measured=NOISE, hardware=LATE, **REQUIRED)
    start = fa.equilibrium(arm, POSTURE).q + 1e-4 * np.eye(arm.dof)[2]  # a mode of link 1
    still = fa.joint_motion(arm, POSTURE, [POSTURE[0] + 1e-9], 0.5)
    options = {"hardware": LATE, "initial": start, "reference": still, "rate": 1000.0}
    run = fa.simulate(arm, 4.0, controller=law, **options)
    # A pole of the same frequency decays three times as fast, and has vanished after 2 s. Changes
    # between samples are those of the vibration, without the constant strain.
    change, time = np.abs(np.diff(run.strain.values[:, 0])), run.time.values[1:]
    first, last = (change[(time >= t) & (time < t + 0.5)].max() for t in (2.0, 3.5))
    slowest = law.loop_poles()[0].real
    assert np.log(last / first) / 1.5 == pytest.approx(slowest, rel=0.1)


def test_errors_along_a_motion_are_those_of_an_ideal_drive(arm):
    """Nominal readings pass the same filters and delays; the nominal torque is requested early."""
    motion = fa.quasi_static_reference(arm, fa.joint_motion(arm, [0.0], [0.5], 0.4, start_time=0.1))
    errors = []
    for hardware in (None, LATE):
        law = fa.LQG(arm, POSTURE, measured=NOISE, hardware=hardware, integral=True)
        run = fa.simulate(
            arm, 1.0, controller=law, reference=motion, hardware=hardware, initial=motion.initial,
            rate=200.0,
        )  # fmt: skip
        angle = np.array([motion.joint_angle(t) for t in run.time.values])
        errors.append(np.abs(run.joint_angle.values - angle)[20:].max())
    # With nominal readings that are not filtered, the error is twice that of the ideal drive.
    assert errors[1] == pytest.approx(errors[0], rel=0.05)


def test_limits_that_do_not_act_leave_the_regulator(arm):
    motion = fa.joint_motion(arm, [0.0], [0.2], 0.4)
    torques = []
    for law in (
        fa.LQG(arm, POSTURE, hardware=LATE, torque_limit=1e3),
        fa.MPC(arm, POSTURE, hardware=LATE, torque_limit=1e3, sample_time=TICK),
    ):
        run = fa.simulate(arm, 0.2, controller=law, reference=motion, hardware=LATE, rate=1000.0)
        torques.append(run.torque.values)
    np.testing.assert_allclose(torques[1], torques[0], rtol=0, atol=1e-6 * np.abs(torques[0]).max())


def test_law_with_hardware_has_a_program(arm):
    law = fa.LQG(arm, POSTURE, measured=NOISE, hardware=LATE)
    shapes = {"joint_angle": 1, "joint_rate": 1, "strain": 1}
    readings = fa.Measurement(**{name: np.full(k, 0.1) for name, k in shapes.items()})
    motion = fa.joint_motion(arm, [0.0], [0.2], 0.4)
    law.update(0.0, readings, motion)
    assert program_of(law, law.memory, readings, law.planned(TICK, motion)) is not None


KEYS = {"hardware": True, "posture": POSTURE}
DRIVES = {
    "lqg": (fa.LQG, {"measured": NOISE}),
    "mpc": (fa.MPC, {"torque_limit": 5.0, "sample_time": TICK}),
    "composite": (fa.Composite, {}),
    "loop_shaping": (fa.LoopShaping, {}),
}


def test_instability_by_the_drive_names_the_cure():
    rod = {"flexural_rigidity": 60.0, "mass_per_length": 0.6, "elements": 2, "damping": 0.01}
    arm = chain([1.0], [0.05], **rod, payload=0.2)
    motors = fa.Motors(delay=TICK, time_constant=2.0 * TICK)
    hardware = fa.Hardware(instruments=[fa.Instrument("joint_angle")], motors=motors)
    options = {"reference": fa.joint_motion(arm, [0.0], [0.0], 0.1), "hardware": hardware}
    encoder = {"measured": {"joint_angle": 1e-4}}
    with pytest.warns(fa.UnstableLoopWarning, match="stable: design it with hardware="):
        fa.simulate(arm, 0.02, controller=fa.LQG(arm, **encoder), **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fa.simulate(arm, 0.02, controller=fa.LQG(arm, hardware=hardware, **encoder), **options)


@pytest.mark.parametrize("kind", DRIVES)
def test_key_of_a_file_is_the_hardware_of_the_scenario(arm, kind):
    make, given = DRIVES[kind]
    content = {"arm": arm.spec, "run": {"duration": 0.02}, "hardware": LATE}
    content["motion"] = {"kind": "joint", "start": [0.0], "end": [0.2], "duration": 0.4}
    scenario = checked_arguments(Scenario, **content, drive={"kind": kind, **KEYS, **given})
    law = prepare(scenario).options["controller"]
    written = make(arm, POSTURE, hardware=LATE, **given)
    for design, other in zip(law.designs, written.designs, strict=True):
        np.testing.assert_array_equal(design.A, other.A)
    del content["hardware"]
    scenario = checked_arguments(Scenario, **content, drive={"kind": kind, **KEYS, **given})
    with pytest.raises(
        fa.InputError, match="hardware requires the key hardware at the top of the file"
    ):
        prepare(scenario)


def test_two_encoders_at_the_joints(arm):
    """The rates are those of a second encoder, whose angles the controller does not read."""
    motor = fa.Instrument("joint_angle", name="motor", rate_cutoff=CUTOFF, rate_name="joint_rate")
    two = LATE.replace(instruments=[fa.Instrument("joint_angle"), motor, LATE.instruments[1]])
    poles = [
        fa.LQG(arm, POSTURE, measured=NOISE, hardware=hardware).loop_poles()[:8]
        for hardware in (LATE, two)
    ]
    np.testing.assert_allclose(poles[1], poles[0], rtol=1e-6)


def test_margins_of_a_search_are_those_with_the_hardware(arm):
    law = fa.LQG.for_margin(arm, POSTURE, plants=arm, disk_margin=0.45, hardware=LATE)
    disk = [
        fa.loop_margins(law, arm, [POSTURE], hardware=hardware).disk_margin.item()
        for hardware in (LATE, None)
    ]
    assert disk[0] >= 0.45
    # A search for loops without the drive would not accept it.
    assert disk[1] < 0.45


def test_gauges_that_the_hardware_does_not_have_are_not_measured(arm):
    bare = LATE.replace(instruments=[fa.Instrument("joint_angle", rate_cutoff=CUTOFF)])
    law = fa.LQG(arm, POSTURE, hardware=bare)
    assert set(law.design_requirements.measured) == {"joint_angle"}
    assert set(fa.LQG(arm, POSTURE, hardware=LATE).design_requirements.measured) == {
        *("joint_angle", "strain")
    }


def test_refused_hardware(arm):
    slow = LATE.replace(instruments=[fa.Instrument("joint_angle", sample_time=0.01)])
    named = LATE.replace(instruments=[fa.Instrument("joint_angle", name="encoder")])
    late = {"hardware": LATE, "delay": TICK}
    for kind in (fa.LQG, fa.Composite, fa.LoopShaping):
        with pytest.raises(fa.InputError, match="delay cannot be combined with hardware"):
            kind(arm, POSTURE, **late)
        with pytest.raises(fa.InputError, match="hardware has no instrument of joint_angle"):
            kind(arm, POSTURE, hardware=named)
    with pytest.raises(fa.InputError, match="instruments with their own sample_time"):
        fa.LQG(arm, POSTURE, measured={"joint_angle": 1e-4}, hardware=slow)
    with pytest.raises(TypeError, match="hardware"):
        fa.NonlinearMPC(arm, POSTURE, torque_limit=5.0, hardware=LATE)


@pytest.mark.parametrize("hardware", [None, LATE])
def test_an_arm_at_rest_beside_its_reference_has_no_rate(arm, hardware):
    """The filter in its steady state alone would find a tenth of the angle, and a rate instead."""
    law = fa.LQG(arm, POSTURE, measured=NOISE, hardware=hardware, **REQUIRED)
    away, still = 0.006, fa.joint_motion(arm, POSTURE, POSTURE, 1.0)
    start = fa.equilibrium(arm, [POSTURE[0] + away]).q
    options = {"hardware": hardware, "reference": still, "initial": start}
    run = fa.simulate(arm, 0.5 * TICK, controller=law, rate=4000.0, **options)
    state = np.zeros(2 * arm.dof)
    state[0] = away
    # The links sag by the cosine of another angle.
    np.testing.assert_allclose(law.estimate, state, rtol=0, atol=1e-2 * away)
    if hardware is None:
        (balance,) = fa.equilibrium(arm, POSTURE).torque
        expected = -law.designs[0].gain @ state
        assert run.torque.values[0] - balance == pytest.approx(expected, rel=0.05)
