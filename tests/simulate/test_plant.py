"""An arm that is stepped by the caller, against the loop of ``simulate``."""

import copy
import pickle
import warnings

import numpy as np
import pytest

import flexarm as fa
from arms import two_rods
from flexarm.arm.bending import theory_error
from flexarm.simulation.run.validity import BendingWatch

#: A binary fraction, so that samples and sample times are equal to the last bit.
TICK = 2.0**-9
LINK = {"flexural_rigidity": 40.0, "mass_per_length": 0.5, "elements": 1}
START = [0.2, -0.4]


@pytest.fixture(scope="module")
def arm():
    return two_rods(gauged=1)


@pytest.fixture(scope="module")
def motion(arm):
    return fa.joint_motion(arm, START, [0.5, 0.1], 0.3)


def controller():
    return fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=TICK)


NOISY = fa.Hardware(
    [
        fa.Instrument("joint_angle", noise=1e-4, rate_cutoff=100.0),
        fa.Instrument("tip", name="camera", delay=0.013, sample_time=5 * TICK),
        fa.Instrument(fa.Sensor("acceleration", 2, frame="link"), name="accelerometer"),
    ],
    fa.Motors(torque_limit=[0.5, 0.2], delay=0.0013, time_constant=0.002),
    seed=3,
)
#: With these delays the loop is unstable, which hardly shows in so short a time.
UNSTABLE = pytest.mark.filterwarnings("ignore::flexarm.UnstableLoopWarning")
GUST = fa.Load(1, (0.0, 0.3), factor=([0.0, 0.0731, 0.2], [0.0, 1.0, 0.2]))


def stepped(plant, controller, motion, ticks, **start):
    """Step with a controller and return the states at all sample times."""
    controller.reset()
    measurement = plant.reset(**start)
    states = [(plant.q, plant.qd)]
    for _ in range(ticks):
        measurement = plant.step(controller.update(plant.time, measurement, motion))
        states.append((plant.q, plant.qd))
    return measurement, *map(np.array, zip(*states, strict=True))


@pytest.mark.parametrize(
    ("hardware", "outside"),
    [
        (None, {}),
        (NOISY, {}),
        (None, {"loads": [GUST], "tip_force": [0.1, 0.0], "base_acceleration": [0.0, 1.0]}),
        (NOISY, {"integrator": "kennedy_carpenter_5", "rtol": 1e-5, "atol": 1e-7}),
    ],
    ids=["ideal", "hardware", "loads", "implicit"],
)
@pytest.mark.filterwarnings("ignore::flexarm.LimitWarning")  # of motors at their limits
@UNSTABLE
def test_steps_have_the_digits_of_simulate(arm, motion, hardware, outside):
    result = fa.simulate(
        arm,
        100 * TICK,
        controller=controller(),
        reference=motion,
        hardware=hardware,
        rate=1.0 / TICK,
        **outside,
    )
    plant = fa.Plant(arm, TICK, hardware, **outside)
    initial = arm.rest(motion.joint_angle(0.0))
    _, q, qd = stepped(plant, controller(), motion, 100, initial=initial)
    np.testing.assert_array_equal(q, result.q.values)
    np.testing.assert_array_equal(qd, result.qd.values)
    assert plant.time == 100 * TICK
    np.testing.assert_allclose(plant.tip[:2], result.tip.values[-1], rtol=0, atol=1e-14)
    np.testing.assert_allclose(plant.tip, arm.tip(plant.q), rtol=0, atol=1e-14)
    np.testing.assert_allclose(
        plant.tip_velocity, arm.tip_velocity(plant.q, plant.qd), rtol=0, atol=1e-13
    )


@UNSTABLE
def test_readings_equal_those_of_simulate(arm, motion):
    result = fa.simulate(
        arm, 50 * TICK, controller=controller(), reference=motion, hardware=NOISY, rate=1.0 / TICK
    )
    plant, pd = fa.Plant(arm, TICK, NOISY), controller()
    measurement = plant.reset(arm.rest(START))
    for k in range(50):
        for name in ("joint_angle", "joint_rate", "camera", "accelerometer"):
            np.testing.assert_array_equal(measurement[name], result[f"measured_{name}"].values[k])
        assert plant.measurement is measurement
        measurement = plant.step(pd.update(plant.time, measurement, motion))


def test_functions_of_time_act_as_in_simulate(arm, motion):
    load = fa.Load(2, moment=0.2, factor=lambda t: np.sin(40.0 * t))
    result = fa.simulate(
        arm, 50 * TICK, controller=controller(), reference=motion, loads=[load], rate=1.0 / TICK
    )
    plant = fa.Plant(arm, TICK, loads=[load], duration=50 * TICK)
    _, q, _ = stepped(plant, controller(), motion, 50, initial=arm.rest(START))
    np.testing.assert_array_equal(q, result.q.values)
    with pytest.raises(fa.InputError, match=r"must be at most the duration of the plant \(0.09765"):
        plant.step([0.0, 0.0])


def test_reset_makes_runs_equal_and_the_seed_determines_the_noise(arm, motion):
    plant = fa.Plant(arm, TICK, NOISY)
    start = {"initial": arm.rest(START), "initial_rate": np.full(arm.dof, 0.01)}
    first, again, other = (
        stepped(plant, controller(), motion, 30, seed=seed, **start) for seed in (5, 5, 6)
    )
    for a, b in zip(first[1:], again[1:], strict=True):
        np.testing.assert_array_equal(a, b)
    assert np.any(first[1] != other[1])
    np.testing.assert_array_equal(first[2][0], start["initial_rate"])
    # Without a seed, that of the hardware is used.
    own = stepped(plant, controller(), motion, 30, **start)
    given = stepped(plant, controller(), motion, 30, seed=NOISY.seed, **start)
    np.testing.assert_array_equal(own[1], given[1])


def test_two_plants_are_independent(arm, motion):
    _, alone, _ = stepped(fa.Plant(arm, TICK), controller(), motion, 20)
    one, two = fa.Plant(arm, TICK), fa.Plant(arm, TICK)
    pd = controller()
    for k in range(20):
        one.step(pd.update(one.time, one.measurement, motion))
        two.step([0.3 * np.sin(k), -0.2])
        np.testing.assert_array_equal(one.q, alone[k + 1])


def test_plant_is_at_rest_before_its_first_step(arm):
    plant = fa.Plant(arm)
    assert plant.sample_time == 0.001
    assert plant.time == 0.0
    assert plant.warning == ""
    np.testing.assert_array_equal(plant.q, np.zeros(arm.dof))
    np.testing.assert_array_equal(plant.measurement.joint_angle, [0.0, 0.0])
    np.testing.assert_allclose(plant.tip, [1.4, 0.0, 0.0], rtol=0, atol=1e-15)


def test_reading_is_a_copy(arm):
    plant = fa.Plant(arm, TICK)
    plant.measurement.joint_angle[:] = 7.0
    plant.q[:] = 7.0
    np.testing.assert_array_equal(plant.q, np.zeros(arm.dof))


def test_memory_does_not_grow(arm):
    """Earlier torques are not kept, so that a plant may run for days."""
    plant = fa.Plant(arm, TICK, NOISY)
    for _ in range(50):
        plant.step([0.1, 0.0])
    acting = plant._loop.acting
    assert len(acting._since) == len(acting._target) == 1
    assert len(acting._waiting) <= 2


def test_wrong_torques_and_starts_change_nothing(arm):
    plant = fa.Plant(arm, TICK)
    plant.step([0.1, 0.0])
    q = plant.q
    for torque in ([0.1], [np.nan, 0.0], "full speed"):
        with pytest.raises(fa.InputError, match=r"Plant\.step: torque"):
            plant.step(torque)
    for start in ({"initial": [0.0, 0.0]}, {"initial_rate": [0.0, 0.0]}):
        with pytest.raises(fa.InputError, match=r"Plant\.reset: initial"):
            plant.reset(**start)
    np.testing.assert_array_equal(plant.q, q)
    assert plant.time == TICK


def test_diverged_plant_keeps_its_state_and_requires_a_reset(arm):
    plant = fa.Plant(arm, 0.05, integrator="rk4", step=0.05, warn=False)  # far too long a step

    def run():
        for _ in range(200):
            plant.step([1.0, -1.0])

    with pytest.raises(fa.SimulationError, match="the step is too long") as caught:
        run()
    np.testing.assert_array_equal(caught.value.state[0], plant.q)
    assert np.all(np.isfinite(plant.q))
    assert plant.time == caught.value.time
    with pytest.raises(fa.InputError, match=r"the plant stopped at t = .* must be reset"):
        plant.step([0.0, 0.0])
    plant.reset()
    plant.step([0.0, 0.0])
    assert plant.time == 0.05


def test_bending_gives_one_warning(arm):
    bent = arm.from_nodal([0.0, 0.0], [np.array([[0.09, 0.15]]), np.zeros((1, 2))])
    plant = fa.Plant(arm, TICK)
    plant.reset(bent)
    with pytest.warns(fa.LargeDeflectionWarning, match="link 1 deflects"):
        plant.step([0.0, 0.0])
    plant.step([0.0, 0.0])  # a second warning would be an error here
    assert "link 1 deflects" in plant.warning
    plant.reset()
    assert plant.warning == ""
    silent = fa.Plant(arm, TICK, warn=False)
    silent.reset(bent)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        silent.step([0.0, 0.0])
    assert "link 1 deflects" in silent.warning


def test_fast_bending_check_agrees_with_the_full_one(arm):
    rng = np.random.default_rng(0)
    segmented = fa.Arm(links=[fa.Link(length=0.8, segments=3, **(LINK | {"elements": 3}))])
    for one in (arm, segmented, fa.Arm(links=arm.spec.links, theory="second_order")):
        watch, stated = BendingWatch(one), 0
        most = 0.03 if one.spec.theory == "linear" else 0.1
        for _ in range(40):
            state = one.padded(rng.uniform(0.0, most) * rng.standard_normal((2, one.dof)))
            assert watch(state) == theory_error(one, state[None])
            stated += bool(watch(state))
        assert 0 < stated < 40


def test_plant_with_contacts(arm, motion):
    """The wall is in the way of the tip, and the force is measured."""
    tip = motion.tip(0.06)
    wall = fa.Contact(fa.Wall(tip, -(motion.tip(0.3) - tip)), 1e4, damping=0.3)
    result = fa.simulate(
        arm,
        100 * TICK,
        controller=controller(),
        reference=motion,
        contacts=[wall],
        rate=1.0 / TICK,
    )
    assert abs(result.contact_force).max() > 0.1
    plant = fa.Plant(arm, TICK, contacts=[wall])
    initial = arm.rest(motion.joint_angle(0.0))
    measurement, q, _ = stepped(plant, controller(), motion, 100, initial=initial)
    np.testing.assert_array_equal(q, result.q.values)
    np.testing.assert_allclose(measurement.contact_force, result.contact_force[-1], atol=1e-9)
    np.testing.assert_array_equal(plant.contact_force, measurement.contact_force)  # the exact value


@pytest.mark.parametrize("again", [copy.deepcopy, lambda plant: pickle.loads(pickle.dumps(plant))])
@pytest.mark.parametrize(
    "more",
    [{}, {"hardware": NOISY, "loads": [GUST]}, {"contacts": True}],
    ids=["plain", "hardware", "contacts"],
)
def test_copy_continues_from_the_state_of_the_plant(arm, motion, more, again):
    """To the last bit, with noise and delays; the two are independent."""
    if "contacts" in more:
        tip = motion.tip(0.06)
        wall = fa.Wall(tip, -(motion.tip(0.3) - tip))
        more = {"contacts": [fa.Contact(wall, 1e4, damping=0.3)]}
    plant = fa.Plant(arm, TICK, **more)
    plant.reset(arm.rest(START), seed=5)
    rng = np.random.default_rng(0)
    torques = [[0.2, 0.1] + 0.05 * rng.standard_normal(2) for _ in range(80)]
    for torque in torques[:40]:
        plant.step(torque)
    copied = again(plant)
    ahead = [(plant.step(torque), plant.q) for torque in torques[40:]]
    assert copied.time == 40 * TICK
    for torque, (measurement, q) in zip(torques[40:], ahead, strict=True):
        reported = copied.step(torque)
        for name in measurement:
            np.testing.assert_array_equal(reported[name], measurement[name])
        np.testing.assert_array_equal(copied.q, q)
    if "contacts" in more:
        assert abs(copied.contact_force).max() > 0.0
    np.testing.assert_array_equal(copied.tip, plant.tip)
    copied.reset()
    assert plant.time == 80 * TICK


def test_copied_arm_needs_no_new_compilation(arm):
    """Arrays of another type would compile all kernels again."""
    for copied in (copy.deepcopy(arm), pickle.loads(pickle.dumps(arm))):
        for own, other in zip(arm.assembly.constants, copied.assembly.constants, strict=True):
            np.testing.assert_array_equal(own, other)
            assert other.dtype is own.dtype
            assert other.flags.num == own.flags.num
