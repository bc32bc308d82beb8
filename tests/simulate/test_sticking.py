"""Friction that holds: joints that stick, slide to rest, and slip, in every kind of run."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import flexarm as fa
from arms import table_one_arm
from closed_mechanisms import four_bar
from flexarm.model.paths import number_at, with_number
from random_arms import random_spec

#: Random arms are as soft as it comes, which matters neither for sticking nor for energy.
anyhow = pytest.mark.filterwarnings("ignore::flexarm.LargeDeflectionWarning")

INERTIA = 2.0 / 3.0  # of a rod of 2 kg and 1 m about its end
STICKING = ("rk4", "dormand_prince_8", "kennedy_carpenter_5")


def rod(gravity=(0.0, 0.0), joint=None, **friction):
    """A rigid link whose joint has friction."""
    link = fa.Link(length=1.0, mass_per_length=2.0, flexible=False)
    joint = fa.Joint(friction=fa.Friction(**friction), **(joint or {}))
    return fa.Arm(links=[link], joints=[joint], gravity=gravity)


def rods(**friction):
    """Two flexible rods on heavy hubs whose joints have friction."""
    joint = fa.Joint(hub_inertia=0.05, friction=fa.Friction(**{"coulomb": 0.5} | friction))
    return table_one_arm(joints=[joint] * 2)


def strokes(t):
    """Torque that turns both joints to and fro; each of them sticks and slips."""
    return np.array([4.0, 1.5]) * np.sin(8.0 * np.pi * t)


@pytest.mark.parametrize("integrator", ["auto", "kennedy_carpenter_5"])
def test_friction_holds_a_load_for_an_hour(integrator):
    """Coulomb friction of 5 N m against 3.9 N m of gravity; the smoothed law creeps by name."""
    link = fa.Link(length=1.0, flexible=False, mass_per_length=0.8)
    for friction, moved in (({}, 0.0), ({"smoothing_rate": 1e-4}, 3600.0 * 1.04e-4)):
        joint = fa.Joint(friction=fa.Friction(coulomb=5.0, **friction))
        arm = fa.Arm(links=[link], joints=[joint], gravity=(0.0, -9.81))
        run = fa.simulate(arm, 3600.0, initial=[0.0], rate=0.01, integrator=integrator)
        assert -run.joint_angle.values[-1, 0] == pytest.approx(moved, rel=0.05)
        # Steps of an explicit method are at most seven radians long, of 1 rad/s without vibrations.
        assert run.evaluations < 10_000


@pytest.mark.parametrize("integrator", STICKING)
def test_sliding_joint_stops_where_and_when_the_closed_form_says(integrator):
    step = {"step": 1e-3} if integrator == "rk4" else {}
    rate, coulomb = 3.0, 1.5
    stop = rate * INERTIA / coulomb
    result = fa.simulate(
        rod(coulomb=coulomb), 2.0, initial_rate=[rate], rate=1000, integrator=integrator, **step
    )
    t = np.minimum(result.time.values, stop)
    angle = rate * t - 0.5 * coulomb / INERTIA * t * t
    np.testing.assert_allclose(result.joint_angle[:, 0], angle, rtol=0, atol=1e-12)
    assert np.all(result.joint_rate.values[result.time > stop + 1e-3] == 0.0)


def test_bent_link_that_sticks_is_clamped():
    """At static friction above the torque of the vibration the link has its clamped modes."""
    link = fa.Link(length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=4)
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.05, friction=fa.Friction(coulomb=5))])
    clamped = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)])
    start = arm.rest([0.0])
    start[1] = 0.005
    result = fa.simulate(arm, 0.5, initial=start, rate=100)
    wanted = fa.simulate(clamped, 0.5, initial=start[1:], rate=100)
    assert np.all(result.joint_angle == 0.0)
    # The error of the default tolerances.
    np.testing.assert_allclose(result.tip, wanted.tip, rtol=0, atol=1e-7)
    # The reaction of the joint, too, although no coordinate contains it.
    np.testing.assert_allclose(result.joint_moment, wanted.joint_moment, rtol=0, atol=1e-4)


@pytest.mark.thorough_cases("5", "9")
@anyhow
@pytest.mark.parametrize("seed", range(12))
def test_random_arms_at_rest_stay_at_rest(seed):
    """Friction of a random excess over the torques of an equilibrium holds; less does not."""
    rng = np.random.default_rng(seed)
    spec = random_spec(rng, gravity=True)
    arm = fa.Arm(spec)
    rest = fa.equilibrium(arm, rng.uniform(-1.0, 1.0, arm.n_joints))

    def rubbing(factor):
        held = iter(np.abs(rest.torque) * factor)
        return [
            joint if joint.fixed else joint.replace(friction=fa.Friction(coulomb=next(held)))
            for joint in spec.joints
        ]

    for factor, holds in ((rng.uniform(1.001, 3.0), True), (0.97, False)):
        of = fa.Arm(spec.replace(joints=rubbing(factor)))
        result = fa.simulate(of, 0.02, initial=rest.q, rate=500)
        assert bool(np.all(result.joint_rate == 0.0)) == holds


def reference(drive, stiffness, friction, duration, times):
    """Angles and rates of ``rod`` by SciPy, started again at each change, and these times."""
    coulomb, static = friction["coulomb"], friction["static"]
    width, viscous = friction["stribeck_rate"], friction["viscous"]

    def slides(side):
        def slope(t, y):
            level = coulomb + (static - coulomb) * np.exp(-((y[1] / width) ** 2))
            drag = viscous * y[1] + side * level
            return [y[1], (drive(t) - stiffness * y[0] - drag) / INERTIA]

        return slope

    def at_rest(t, y):
        return [0.0, 0.0]

    def beyond(t, y):
        return abs(drive(t) - stiffness * y[0]) - static

    def turning(t, y):
        return y[1]

    t, y, side, states, changes = 0.0, np.zeros(2), 0, np.zeros((len(times), 2)), []
    while True:
        if side:
            slope, event = slides(side), turning
            event.direction = -side
        else:
            slope, event = at_rest, beyond
            event.direction = 1
        event.terminal = True
        run = solve_ivp(
            slope, (t, duration), y, "DOP853", events=event, dense_output=True, max_step=0.01,
            rtol=1e-12, atol=1e-13,
        )  # fmt: skip
        now = (times >= t) & (times <= run.t[-1])
        states[now] = run.sol(times[now]).T
        t, y = run.t[-1], run.y[:, -1]
        if t >= duration:
            return states, changes
        changes.append(t)
        pull = drive(t) - stiffness * y[0]
        if side:
            y[1], side = 0.0, 0 if abs(pull) <= static else int(np.sign(pull))
        else:
            y[1], side = np.sign(pull) * 1e-300, int(np.sign(pull))


@pytest.mark.sampled("dormand_prince_8")
@pytest.mark.parametrize("integrator", STICKING)
def test_stick_slip_agrees_with_an_event_driven_solution(integrator):
    def drive(t):
        return 3.0 * np.sin(1.4 * np.pi * t) + 0.8 * np.sin(4.6 * np.pi * t)

    friction = {"coulomb": 1.0, "static": 1.8, "stribeck_rate": 0.3, "viscous": 0.05}
    times = np.linspace(0.0, 8.0, 801)
    states, changes = reference(drive, 3.0, friction, 8.0, times)
    assert len(changes) == 11
    arm = rod(joint={"stiffness": 3.0}, **friction)
    step = {"step": 1e-3} if integrator == "rk4" else {}
    result = fa.simulate(
        arm, 8.0, torque=lambda t: [drive(t)], rate=100, integrator=integrator, **step
    )
    # Observed: 5e-8 and 3e-7 at the default tolerances; 4e-6 with fixed steps, whose slips begin
    # at the end of the step.
    error = 2e-5 if integrator == "rk4" else 1e-6
    np.testing.assert_allclose(result.joint_angle[:, 0], states[:, 0], rtol=0, atol=error)


@pytest.mark.thorough_cases("0", "1")
@anyhow
@pytest.mark.parametrize("seed", range(10))
def test_energy_is_lost_alone(seed):
    """Random arms without drive and gravity stick and slip; friction takes energy, never gives."""
    rng = np.random.default_rng(100 + seed)
    spec = random_spec(rng, gravity=False)
    levels = 10.0 ** rng.uniform(-2.0, 0.5, len(spec.joints))
    joints = [
        joint
        if joint.fixed
        else joint.replace(friction=fa.Friction(coulomb=level, static=1.5 * level))
        for joint, level in zip(spec.joints, levels, strict=True)
    ]
    arm = fa.Arm(spec.replace(joints=joints))
    start = rng.normal(size=arm.dof)
    result = fa.simulate(arm, 0.1, initial=arm.rest(np.zeros(arm.n_joints)), initial_rate=start,
                         rate=5000, rtol=1e-9, atol=1e-11)  # fmt: skip
    energy = (result.kinetic_energy + result.strain_energy).values
    # The error of the integrator, over some hundred steps.
    assert np.diff(energy).max() < 1e-7 * energy[0]


@pytest.mark.compiled
def test_errors_fall_with_the_tolerance():
    """Every slip is seen, however short, so that no tolerance misses one."""
    how = {"torque": strokes, "rate": 200, "integrator": "dormand_prince_8"}
    exact = fa.simulate(rods(), 0.4, rtol=1e-12, atol=1e-14, **how)
    counts = []
    for rtol, error in ((1e-5, 1e-6), (1e-7, 1e-8), (1e-9, 1e-9)):
        run = fa.simulate(rods(), 0.4, rtol=rtol, atol=rtol / 100, **how)
        assert abs(run.tip - exact.tip).max() < error
        counts.append(run.evaluations)
    # The smoothed law at 0.01 rad/s takes 5,000 evaluations, by the implicit method.
    assert counts[1] < 15_000


@pytest.mark.sampled("dormand_prince_8")
@pytest.mark.compiled
@pytest.mark.parametrize("integrator", STICKING[1:])
def test_sensitivities_through_stick_and_slip_equal_differences(integrator):
    """In tight tolerances; the times of sticking and turning have derivatives of their own."""
    arm, path = rods(), "joints[1].friction.coulomb"
    how = {"torque": strokes, "rate": 100.0, "integrator": integrator}
    how |= {"rtol": 1e-10, "atol": 1e-12}
    value = number_at("path", arm.spec, path)
    slopes = fa.sensitivities(arm, 0.3, [path], channels=["joint_angle"], **how)
    more, less = (
        fa.simulate(fa.Arm(with_number(arm.spec, path, factor * value)), 0.3, **how)
        for factor in (1.0 + 1e-5, 1.0 - 1e-5)
    )
    wanted = (more.joint_angle - less.joint_angle).values / (2e-5 * value)
    error = np.abs(slopes.joint_angle.values[0] - wanted).max()
    assert error < 1e-5 * np.abs(wanted).max()


@pytest.mark.thorough
@pytest.mark.compiled
@pytest.mark.parametrize("static", [0.5, 1.0])
@pytest.mark.parametrize("integrator", STICKING[1:])
def test_error_estimates_of_sensitivities_cover_the_errors(integrator, static):
    """At the default tolerances; without a second run the errors were up to 3e-3, in silence."""
    arm, path = rods(static=static, stribeck_rate=0.05), "joints[1].hub_inertia"
    how = {"torque": strokes, "rate": 100.0, "integrator": integrator}
    slopes = fa.sensitivities(arm, 0.3, [path], channels=["joint_angle"], **how)
    value = number_at("path", arm.spec, path)
    more, less = (
        fa.simulate(changed, 0.3, **how, rtol=1e-12, atol=1e-14)
        for changed in (fa.Arm(with_number(arm.spec, path, value * f)) for f in (1.00001, 0.99999))
    )
    wanted = (more.joint_angle - less.joint_angle).values / (2e-5 * value)
    error = np.abs(slopes.joint_angle.values[0] - wanted).max() / np.abs(wanted).max()
    assert error < min(5e-5, 2.0 * float(slopes.relative_error[0]))


@pytest.mark.parametrize("integrator", STICKING)
def test_short_torque_releases_a_joint_that_sticks(integrator):
    """Steps of a joint that sticks are long; all methods but rk4 once missed a pulse of 20 ms."""

    def pulse(t):
        return [3.0 * np.exp(-(((t - 0.255) / 0.02) ** 2))]

    step = {"step": 0.05} if integrator == "rk4" else {}
    result = fa.simulate(rod(coulomb=1.0), 1.0, torque=pulse, integrator=integrator, **step)
    # A fixed step begins the slip at its end: its warning begins at 1e-3.
    allowed = 1e-3 if step else 1e-6
    assert result.joint_angle.values[-1, 0] == pytest.approx(0.003937224, abs=allowed)
    assert result.warning == ""


def test_fixed_steps_through_stick_and_slip_are_compared_with_half_the_step():
    arm = rod(coulomb=1.0)
    drive = {"torque": lambda t: [2.0 * np.sin(9.0 * t)], "integrator": "rk4"}
    exact = fa.simulate(arm, 2.0, torque=drive["torque"])
    with pytest.warns(fa.AccuracyWarning, match="a fixed step may miss where friction"):
        coarse = fa.simulate(arm, 2.0, **drive, step=0.1)
    fine = fa.simulate(arm, 2.0, **drive, step=0.002)
    errors = [np.abs(run.joint_angle - exact.joint_angle).max() for run in (coarse, fine)]
    assert errors[0] > 1e-3 > errors[1]
    assert fine.warning == ""


def test_exact_derivative_of_a_turn():
    """A joint turns back under a constant torque: angle and rate afterwards, by Coulomb's level."""
    arm = rod(coulomb=1.0)
    run = {"initial_rate": [2.0], "torque": lambda t: [-3.0], "rate": 100.0}
    slopes = fa.sensitivities(
        arm, 1.0, ["joints[0].friction.coulomb"], channels=["joint_angle", "joint_rate"], **run
    )
    # Until 2 I / (3 + c) the acceleration is -(3 + c) / I, afterwards it is -(3 - c) / I.
    c, t = 1.0, 1.0
    turn, by = 2.0 * INERTIA / (3.0 + c), -2.0 * INERTIA / (3.0 + c) ** 2
    rate = ((t - turn) + (3.0 - c) * by) / INERTIA
    angle = by + (0.5 * (t - turn) ** 2 + (3.0 - c) * (t - turn) * by) / INERTIA
    assert slopes.joint_rate.values[0, -1, 0] == pytest.approx(rate, rel=1e-9)
    assert slopes.joint_angle.values[0, -1, 0] == pytest.approx(angle, rel=1e-9)


def test_closed_loops_and_plants_stick():
    """A PD without integral stops short of its goal, within what friction can hold."""
    arm = rod(coulomb=1.0)
    goal = fa.joint_motion(arm, start=[0.0], end=[0.5], duration=0.2)
    loop = fa.JointPD([10.0], [4.0], sample_time=1e-3)
    run = fa.simulate(arm, 3.0, controller=loop, reference=goal, rate=1000)
    final = run.joint_angle.values[-1, 0]
    assert np.all(run.joint_rate.values[-500:] == 0.0)
    assert 10.0 * abs(0.5 - final) <= 1.0
    plant = fa.Plant(arm, sample_time=1e-2)
    for _ in range(50):
        plant.step([0.99])
    assert plant.q[0] == plant.qd[0] == 0.0
    plant.step([1.01])
    assert plant.qd[0] > 0.0


def test_accelerometer_of_a_sticking_joint_measures_gravity_alone():
    arm = rod(gravity=(0.0, -9.81), coulomb=20.0)
    sensor = fa.Sensor("acceleration", link=1, frame="link", name="accelerometer")
    plant = fa.Plant(arm, 1e-2, hardware=fa.Hardware([fa.Instrument(sensor)]))
    reading = plant.step([3.0])["accelerometer"]
    np.testing.assert_allclose(reading, [0.0, 9.81], rtol=0, atol=1e-12)


@pytest.mark.parametrize("integrator", ["cowell_4", "gauss_6", "generalized_alpha"])
def test_methods_that_cannot_lock_joints_refuse(integrator):
    with pytest.raises(fa.InputError, match=r"friction that holds \(arm\.joints\[0\]\)"):
        fa.simulate(rod(coulomb=1.0), 0.1, integrator=integrator)
    fa.simulate(rod(coulomb=1.0, smoothing_rate=0.1), 0.01, integrator=integrator, step=1e-3)


def test_linear_models_warn_of_a_stuck_joint():
    arm = rod(coulomb=1.0, static=2.0)
    with pytest.warns(
        fa.FlexarmWarning, match=r"arm\.joints\[0\] \(200 N m s/rad\): friction holds"
    ):
        model = fa.linearize(arm)
    assert model.A[1, 1] == pytest.approx(-200.0 / INERTIA)
    with pytest.warns(fa.FlexarmWarning, match="friction holds"):
        fa.modes(arm, joints="free")
    fa.linearize(arm, [0.0], qd=[1.0])  # a sliding joint, without a warning
    fa.linearize(rod(coulomb=1.0, smoothing_rate=0.01))  # the law that was asked for
    fa.modes(rods(coulomb=1.0))  # locked joints


@pytest.mark.parametrize("flexible", [False, True])
def test_friction_that_holds_more_joints_than_a_loop_leaves_free_is_refused(flexible):
    # A four-bar moves in one way: two joints at rest hold it twice, and the run had no solution.
    holds, smooth = fa.Friction(coulomb=0.2), fa.Friction(coulomb=0.2, smoothing_rate=1e-3)

    def run(*frictions, prescribed=None, **gear):
        joints = [fa.Joint(hub_inertia=0.05, friction=frictions[0], **gear)]
        joints += [fa.Joint(friction=frictions[1], **gear), fa.Joint(offset=(1.0, 0.0))]
        closed = four_bar(flexible=flexible, joints=joints)
        arm = fa.Arm(closed.spec)
        start = fa.assembled(arm, arm.rest(closed.joints), held=[1]).q
        torque = None if prescribed else lambda _: [3.0, 0.0, 0.0]
        held = {1: fa.PrescribedAngle.hold(closed.joints[0])} if prescribed else None
        return fa.simulate(arm, 0.02, initial=start, torque=torque, prescribed=held)

    words = r"friction of arm.joints\[0\], arm.joints\[1\] holds more .* smoothing_rate"
    with pytest.raises(fa.InputError, match=words):
        run(holds, holds)
    for frictions in ((holds, None), (None, holds), (holds, smooth), (smooth, smooth)):
        assert np.all(np.isfinite(run(*frictions)["q"].values))
    # A gear lets its joint move beside its motor, and friction cannot stop a prescribed motion.
    assert np.all(np.isfinite(run(holds, holds, stiffness=100.0, rotor_inertia=0.01)["q"].values))
    assert np.all(np.isfinite(run(holds, holds, prescribed=True)["q"].values))
