"""Optimal motions as motions and torques, partial rest, and errors."""

import pickle
import sys
from functools import cache

import numpy as np
import pytest

import flexarm as fa
import flexarm.planning.optimize.optimal_motion as optimal
from flexarm.planning.optimize.task import GAUSS
from flexarm.planning.optimize.transcription import Answer, Transcription

LINK = {"length": 1.0, "flexural_rigidity": 30.0, "mass_per_length": 0.5}
LIMITS = fa.MotionLimits(torque=4.0)


@cache
def arm(modes=1, gravity=(0.0, 0.0)):
    return fa.Arm(
        links=[fa.Link(modes=modes, **LINK)],
        joints=[fa.Joint(hub_inertia=0.1)],
        gravity=gravity,
    )


@cache
def move():
    return fa.optimal_motion(arm(), [0.0], [0.8], limits=LIMITS)


def test_motion_is_that_of_the_simulated_joints():
    motion = move()
    run = fa.simulate(arm(), motion.duration, torque=motion.torque, initial=motion.initial)
    times = run.time.values
    # Three Gauss points per interval, and polynomials of degree 5.
    np.testing.assert_allclose(motion.joint_angle(times), run.joint_angle, atol=1e-6)
    np.testing.assert_allclose(motion.joint_rate(times), run.joint_rate, atol=1e-4)
    inside = 0.5 * np.add(motion.breaks[:-1], motion.breaks[1:])
    q, qd = (run[name].interp(time=inside, method="cubic").values for name in ("q", "qd"))
    torque = motion.torque(inside)
    rows = [arm().forward_dynamics(*state)[0] for state in zip(q, qd, torque, strict=True)]
    wanted = np.array(rows)
    found = motion.joint_acceleration(inside)[:, 0]
    np.testing.assert_allclose(found, wanted, atol=1e-3 * np.abs(wanted).max())


def test_refined_plan_is_the_same_motion():
    motion = move()
    plan = motion._plan.refined(2 * motion.intervals, continuous=False)
    half = motion._plan.refined(motion.intervals // 2, continuous=False)
    # Polynomials of the collocation, here in the middle of an interval: order 4 of h = 1 / 40.
    q, rate = motion.joint_angle(plan.times), motion.joint_rate(plan.times)
    np.testing.assert_allclose(plan.q[:, :1], q, atol=1e-6)
    np.testing.assert_allclose(plan.rate[:, :1], rate, atol=1e-4)
    np.testing.assert_array_equal(plan.torque[::2], motion._plan.torque)
    np.testing.assert_allclose(half.q, motion._plan.q[::2], atol=1e-12)
    stages = (plan.times[:-1, None] + motion.duration / plan.intervals * GAUSS.c).ravel()
    curve = motion.duration**2 * motion.joint_acceleration(stages)[:, 0]
    np.testing.assert_allclose(plan.curve[..., 0].ravel(), curve, atol=2e-3 * np.abs(curve).max())


def test_motion_is_a_reference_of_controllers():
    motion = move()
    control = fa.JointPD([40.0], [4.0], feedforward=motion.torque, sample_time=0.001)
    run = fa.simulate(arm(), 2.0 * motion.duration, controller=control, reference=motion)
    after = run.sel(time=slice(motion.duration, None))
    # The feedforward is constant over each sample of 1 ms, so it switches up to 0.5 ms late.
    assert np.abs(after.joint_angle - 0.8).max() < 0.01
    assert np.abs(after.link_tip_deflection).max() < 0.1 * np.abs(run.link_tip_deflection).max()
    again = pickle.loads(pickle.dumps(motion))
    assert again.duration == motion.duration
    assert repr(again) == repr(motion)
    np.testing.assert_array_equal(again.torque(0.1), motion.torque(0.1))


def test_under_gravity_the_arm_starts_and_ends_in_equilibrium():
    heavy = arm(gravity=(0.0, -9.81))
    motion = fa.optimal_motion(heavy, [-1.5], [-0.5], limits=fa.MotionLimits(torque=6.0))
    ends = [fa.equilibrium(heavy, angle) for angle in ([-1.5], [-0.5])]
    np.testing.assert_allclose(motion.initial, ends[0].q, atol=1e-12)
    np.testing.assert_allclose(motion.torque(9.0), ends[1].torque, atol=1e-12)
    assert motion.remaining.residual_vibration < 1e-5
    assert motion.remaining.tip_error < 1e-5


@pytest.mark.thorough
def test_only_the_given_modes_rest_at_the_end():
    full = arm(modes=3)
    one, every = (
        fa.optimal_motion(full, [0.0], [0.8], "energy", duration=0.4, modes=count, intervals=80)
        for count in (1, None)
    )
    free = fa.modes(full, q=one.final, joints="free")
    rows = free.shapes @ full.mass_matrix(one.final)

    def left(motion):
        """Return the amplitudes of rates at the end: of the rigid arm, and of its vibrations."""
        run = fa.simulate(full, motion.duration, torque=motion.torque, initial=motion.initial)
        last = run.q.values[-1] - motion.final
        return np.hypot(2.0 * np.pi * free.frequency_hz * (rows @ last), rows @ run.qd.values[-1])

    assert (one.modes, every.modes) == (1, 3)
    first, all_of_them = left(one), left(every)
    assert np.all(first[:2] < 1e-3 * first[2])
    assert np.all(all_of_them[:3] < 0.1 * first[2])


def test_torque_holds_the_arm_outside_the_motion():
    heavy = arm(gravity=(0.0, -9.81))
    motion = fa.optimal_motion(heavy, [-1.5], [-0.5], limits=fa.MotionLimits(torque=6.0))
    held = [fa.equilibrium(heavy, angle).torque for angle in ([-1.5], [-0.5])]
    for time, torque in zip([[-np.inf, -1.0], [motion.duration, np.inf]], held, strict=True):
        np.testing.assert_allclose(motion.torque(time), [torque, torque], atol=1e-12)


def test_plant_with_more_modes_is_what_remains():
    motion = fa.optimal_motion(arm(), [0.0], [0.8], limits=LIMITS, plant=arm(modes=3))
    assert motion.run.sizes["coordinate"] == 4
    assert motion.remaining.residual_vibration > 10.0 * move().remaining.residual_vibration
    assert "residual vibration" in str(motion.remaining)


def call(**changed):
    given = {"arm": arm(), "start": [0.0], "end": [0.8], "limits": LIMITS} | changed
    return fa.optimal_motion(**given)


def test_too_short_a_duration_is_an_error_with_the_last_iterate():
    short = 0.5 * move().duration
    with pytest.raises(fa.OptimizationError, match="objective='time' finds") as error:
        call(objective="energy", duration=short)
    assert error.value.last.time.values[-1] == pytest.approx(short)
    assert error.value.last.sizes["coordinate"] == arm().dof


def test_too_few_iterations_are_an_error_with_the_last_iterate():
    with pytest.raises(fa.OptimizationError, match="after 2 iterations") as error:
        call(iterations=2)
    assert "Maximum_Iterations_Exceeded" in error.value.reason
    last = error.value.last
    assert last.joint_angle.values[[0, -1], 0] == pytest.approx([0.0, 0.8])


def test_a_feasible_iterate_that_is_no_solution_names_fast_modes(monkeypatch):
    def failed(self):
        plan = self._plan(*(part.T for part in self.guess.values()))
        return Answer(plan, "Error_In_Step_Computation", False, 21, 1e-12)

    monkeypatch.setattr(Transcription, "solve", failed)
    with pytest.raises(fa.OptimizationError, match=r"reduce the modes of links \(Link.modes\)"):
        call()


@pytest.mark.thorough
def test_guess_selects_the_side_of_an_obstacle():
    """The tip of a rigid arm passes a post in its way on the side of the guess."""
    rigid = fa.Arm(links=[fa.Link(length=1.0, flexible=False, mass_per_length=0.5)] * 2)
    start, end = (fa.inverse_kinematics(rigid, point) for point in ((1.2, -0.8), (1.2, 0.8)))
    limits = fa.MotionLimits(torque=[6.0, 2.0], obstacles=[fa.RoundWall((1.2, 0.0), 0.15)])
    sides = []
    for x in (0.8, 1.6):
        guess = fa.spline_motion(rigid, [(1.2, -0.8), (x, 0.0), (1.2, 0.8)], 2.0)
        motion = fa.optimal_motion(rigid, start, end, "energy", limits, duration=2.0, guess=guess)
        tip = motion.run.tip.values
        sides.append(float(tip[np.argmin(np.abs(tip[:, 1])), 0]))
    assert sides[0] < 1.06
    assert sides[1] > 1.34


def test_missing_casadi_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(fa.InputError, match=r"optimal_motion: CasADi is not installed.*casadi"):
        call()


def unresolved():
    """Return a call whose twelve intervals do not resolve the second mode of each link."""
    rod = {"flexural_rigidity": 105.0, "mass_per_length": 0.6, "modes": 2}
    links = [fa.Link(length=1.0, **rod), fa.Link(length=0.8, **rod)]
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(mass=0.5, hub_inertia=0.02)]
    call = [fa.Arm(links=links, joints=joints), [0.0, 0.0], [1.2, -0.8], "energy"]
    return fa.optimal_motion(*call, duration=1.2, intervals=12, modes=1)


@pytest.mark.thorough
def test_modes_that_are_not_resolved_rest_in_the_simulation():
    motion = unresolved()
    assert motion.remaining.tip_error < 1e-3 * 1.8
    assert motion.remaining.joint_error < 1e-6


@pytest.mark.thorough
def test_a_missed_goal_is_reported(monkeypatch):
    monkeypatch.setattr(optimal, "_corrected", lambda task, plan: plan)
    with pytest.warns(fa.AccuracyWarning, match=r"0\.0\d+ m from its goal.*Limit the torque_rate"):
        unresolved()


@pytest.mark.thorough
def test_joints_without_inertia_reach_their_goal():
    """Their angles follow modes that are faster than the default intervals resolve.

    By the collocation alone, the tip misses its goal by 23 mm, and by 1.3 m with ``modes=1``.
    """
    rod = {"flexural_rigidity": 60.0, "mass_per_length": 0.5}
    light = fa.Arm(links=[fa.Link(length=1.0, elements=1, **rod)] * 2)
    call = [light, [0.2, -0.4], [0.9, 0.5], "energy"]
    for modes, limits in ((None, None), (1, None), (None, fa.MotionLimits(torque_rate=100.0))):
        motion = fa.optimal_motion(*call, limits, duration=1.5, modes=modes, intervals=60)
        # The end of Newton's method, relative to the motion, times the reach.
        assert motion.remaining.tip_error < 1e-6
        assert motion.remaining.joint_error < 1e-7
        run = motion.run.sel(time=slice(None, 1.5))
        nodes = run.interp(time=np.array(motion.breaks))
        np.testing.assert_allclose(motion.joint_angle(nodes.time), nodes.joint_angle, atol=1e-5)
        if limits is not None:
            slope = np.abs(np.diff(motion._plan.torque, axis=1)).max() * 60 / 1.5
            assert 90.0 < slope < 100.0 * (1.0 + 1e-6)
