"""Choice of the integrator by the work of the whole run, and refusal of hopeless runs."""

import warnings

import numpy as np
import pytest

import flexarm as fa
from flexarm.integrate import DormandPrince8
from flexarm.simulation.calls.preparation import integrator_of
from random_arms import random_spec

#: Fall of a rigid rod of 1 m from the horizontal for one second, under 9.81 m/s^2: its tip (m).
FALLEN = -0.99996659, -0.00817452
#: Evaluations (about ten milliseconds) below which the choice does not matter.
FEW = 1e5


def rod(rigidity, **options):
    link = fa.Link(length=1.0, flexural_rigidity=rigidity, mass_per_length=1.0)
    return fa.Arm(links=[link], gravity=(0.0, -9.81), **options)


#: An arm with a controller, and one.
HUB = rod(100.0, joints=[fa.Joint(hub_inertia=1.0)])
GENTLE = fa.JointPD([50.0], [10.0])


def fall(arm, duration=1.0, **settings):
    settings = {"rate": 100.0, "initial": arm.rest([0.0]), **settings}
    return fa.simulate(arm, duration, progress=False, **settings)


def test_a_short_run_of_a_stiff_link_takes_the_cheaper_method():
    """The explicit method takes 14,000 evaluations, of which the estimate expects 10,000."""
    arm = rod(1e5, joints=[fa.Joint(hub_inertia=0.1)])
    chosen = fall(arm, 0.02, rate=500.0)
    explicit = fall(arm, 0.02, rate=500.0, integrator="dormand_prince_8")
    assert chosen.evaluations < 0.1 * explicit.evaluations
    assert 5_000 < explicit.evaluations < 20_000


@pytest.mark.parametrize("rigidity", [1e4, 1e6, 1e8, 1e10])
def test_a_link_that_is_almost_rigid_falls_like_a_rigid_one(rigidity):
    """An explicit method takes 39 thousand to 17 million steps a second."""
    result = fall(rod(rigidity))
    assert result.integrator == "kennedy_carpenter_5"
    assert result.steps < 6000
    # Twenty times rtol: 35 steps of up to 0.15 rad, each of which errs by rtol times the angle.
    np.testing.assert_allclose(result.tip.values[-1, :2], FALLEN, rtol=0, atol=2.5e-6)


@pytest.mark.thorough
def test_visible_vibrations_are_followed():
    arm = rod(100.0)
    result, tight = fall(arm, 2.5, rtol=1e-7), fall(arm, 2.5, rtol=1e-11, atol=1e-13)
    assert result.integrator == "dormand_prince_8"
    np.testing.assert_allclose(result.tip, tight.tip, rtol=0, atol=1e-7)


def stiffened(spec, factor):
    links = [
        link.model_copy(update={"flexural_rigidity": link.flexural_rigidity * factor})
        for link in spec.links
    ]
    return fa.Arm(spec.model_copy(update={"links": tuple(links)}))


def drawn(seed, factor):
    """Return a random arm with a rigidity multiplied by ``factor``, and arguments of a run."""
    rng = np.random.default_rng(seed)
    while True:
        spec = random_spec(rng, rigid=False, reduced=True)
        if all(link.flexural_rigidity is not None for link in spec.links):
            break
    arm, size = stiffened(spec, factor), rng.uniform(1.0, 5.0, len(spec.links))
    start = arm.rest(rng.uniform(-1.0, 1.0, arm.n_joints))
    return arm, {"initial": start, "torque": lambda t: size * np.sin(2.0 * np.pi * t)}


@pytest.mark.thorough_cases("4", "6", "10")
@pytest.mark.parametrize("power", range(-6, 11, 2))
def test_work_of_random_arms_is_near_that_of_the_best_method(power):
    """No method takes less than a third of the evaluations, or the run takes milliseconds."""
    for seed in range(3):
        rng = np.random.default_rng([seed, power + 6])
        duration = float(10.0 ** rng.uniform(-3.0, 1.5 if power >= 4 else 0.3))
        arm, settings = drawn(seed, 10.0**power)
        settings |= {"rate": 10.0 / duration, "progress": False}
        choice = integrator_of(arm, duration=duration, **settings)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
            try:
                result, other = (
                    fa.simulate(arm, duration, integrator=name, **settings)
                    for name in ("auto", "kennedy_carpenter_5")
                )
            except fa.SimulationError:  # soft links bend beyond the theory
                assert power < 0
                continue
            assert result.evaluations < max(3 * other.evaluations, FEW)
            if choice.integrator.name == "kennedy_carpenter_5" and "second" not in choice.reason:
                # An explicit method takes at least one evaluation per radian.
                assert result.evaluations < choice.fastest * duration


@pytest.mark.sampled("6-5")
@pytest.mark.parametrize(("power", "seed"), [(2, 3), (5, 4), (6, 5)])
def test_implicit_method_is_as_accurate_as_the_tolerance_promises(power, seed):
    arm, settings = drawn(seed, 10.0**power)
    settings |= {"rate": 100.0, "progress": False}
    result = fa.simulate(arm, 1.0, **settings)
    assert result.integrator == "kennedy_carpenter_5" or power == 2
    if power == 6:  # a vibration of 1e-9 of the reach: rigid links, which any method follows
        settings["initial"] = settings["initial"][arm.joint_index]
        arm = arm.rigid()
    exact = fa.simulate(arm, 1.0, rtol=1e-11, atol=1e-13, integrator=DormandPrince8(), **settings)
    error = np.linalg.norm((result.tip - exact.tip).values, axis=1).max()
    assert error < 3e-6 * arm.link_lengths.sum()


def test_an_hour_of_a_slow_arm_and_of_a_stiff_one():
    slow = fa.Link(length=10.0, flexural_rigidity=2e4, mass_per_length=30.0, elements=1, modes=1)
    arm = fa.Arm(links=[slow], joints=[fa.Joint(damping=500.0)])
    turning = {"torque": lambda t: [np.sin(0.01 * t)], "rate": 0.1, "progress": False}
    assert fa.simulate(arm, 3600.0, **turning).sizes["time"] == 361
    stiff = rod(1e10, joints=[fa.Joint(damping=5.0)])
    result = fall(stiff, 3600.0, rate=0.1)
    assert result.evaluations < 1e5
    assert result.tip.values[-1, 1] == pytest.approx(-1.0, abs=1e-6)


@pytest.mark.thorough
def test_hopeless_runs_are_refused_with_the_remedy():
    arm = rod(1e10)
    for name in ("dormand_prince_8", "rk4"):
        with pytest.raises(fa.InputError, match=f"{name} would take about 2e.08 .*'auto'"):
            fall(arm, integrator=name)
    with pytest.raises(fa.InputError, match=r"would take .* 1e\+07 s.*is it in seconds"):
        fall(rod(100.0), 1e7, rate=1e-3)
    with pytest.raises(fa.InputError, match="would take"):
        fall(HUB, 1e7, rate=1e-3, controller=GENTLE)
    # An object is not refused, nor is a run that an event ends.
    assert fall(arm, 1e-5, rate=1e6, integrator=DormandPrince8()).integrator == "dormand_prince_8"
    below = fa.joint_event(arm, 1, -1e-6, terminal=True)
    ended = fall(arm, integrator="dormand_prince_8", events=[below])
    assert ended.ended_by != "duration"


def test_batches_report_hopeless_runs_and_choose_like_single_runs():
    arm = rod(1e10)
    start = np.zeros((2, arm.dof))
    batch = fa.simulate_batch(arm, 1.0, initial=start, integrator="dormand_prince_8")
    assert all("would take about" in text for text in batch.failure.values)
    start[:, 0] = 0.0, 0.3
    batch = fa.simulate_batch(arm, 1.0, initial=start, rate=10.0)
    single = [fa.simulate(arm, 1.0, initial=q, rate=10.0) for q in start]
    assert batch.integrator.values.tolist() == ["kennedy_carpenter_5"] * 2
    for k, result in enumerate(single):
        np.testing.assert_array_equal(batch.tip.values[k], result.tip.values)


def test_loops_and_plants_follow_no_vibration_that_turns_often_in_a_sample():
    arm = rod(1e8, joints=[fa.Joint(hub_inertia=1.0)])
    soft = fa.Arm(HUB.spec.replace(links=[HUB.spec.links[0].replace(modes=2)]))
    loop, slow = (fa.simulate(one, 0.05, controller=GENTLE, progress=False) for one in (arm, soft))
    assert (loop.integrator, slow.integrator) == ("kennedy_carpenter_5", "dormand_prince_8")
    assert loop.evaluations < 2000
    plant = fa.Plant(arm)
    for _ in range(50):
        plant.step([0.0])
    exact = fall(arm, 0.05)
    np.testing.assert_allclose(plant.q[0], exact.q.values[-1, 0], rtol=0, atol=1e-6)


def test_loops_leave_fast_vibrations_to_the_implicit_method_only_where_errors_stay_small():
    """The fastest vibration turns by 13 rad in a sample time; friction may amplify errors."""
    law = fa.JointPD(5.0, 3.0, sample_time=2e-3)
    rod_of = {"flexural_rigidity": 300.0, "mass_per_length": 0.5, "elements": 8, "modes": 4}
    start, motors = {"initial_rate": [0.5, *[0.0] * 4]}, {"hub_inertia": 1.0}
    evaluations = []
    for friction, name in ((None, "kennedy_carpenter_5"), (0.01, "dormand_prince_8")):
        rubs = friction and fa.Friction(coulomb=friction)
        joints = [fa.Joint(friction=rubs, **motors)]
        arm = fa.Arm(links=[fa.Link(length=1.0, **rod_of)], joints=joints)
        loop = {"controller": law, "progress": False, **start}
        result = fa.simulate(arm, 0.4, **loop)
        assert result.integrator == name
        exact = fa.simulate(arm, 0.4, integrator="dormand_prince_8", rtol=1e-11, **loop)
        assert np.abs(result.tip - exact.tip).max() < result.attrs["accuracy"]
        evaluations.append(result.evaluations)
    # One or two steps of nine evaluations a sample instead of four or more of twelve.
    assert evaluations[0] < 0.6 * evaluations[1]


def test_check_recommends_the_integrator_of_the_run():
    stiff, smooth = ((r, {"accuracy": 1e-3}, "kennedy_carpenter_5") for r in (1e8, 100.0))
    for rigidity, how, name in (stiff, smooth, (100.0, {"rtol": 1e-7}, "dormand_prince_8")):
        arm = rod(rigidity)
        choice = integrator_of(arm, duration=1.0, **how)
        result = fall(arm, **how)
        assert choice.integrator.name == name == result.integrator
        assert choice.reason == result.integrator_reason
