"""The task of sliding along a wall with a force, against the contact law and its documentation."""

import gymnasium
import numpy as np
import pytest

import flexarm as fa
from flexarm.bridges.gymnasium_env import ENVIRONMENTS, laboratory_arm

FORCE = "flexarm/TrackForce-v0"
REACH = 2.4142  # m, of the laboratory arm


class Pressing:
    """Joint PD along the wall, with feedforward of the force and an integral of its error."""

    def __init__(self):
        self.sum, self.touched = 0.0, False

    def __call__(self, arm_env):
        plant, arm = arm_env.plant, arm_env.arm
        seen, tick = plant.measurement, round(plant.time / plant.sample_time)
        angle, rate, _ = arm_env.motion.state(plant.time)
        wanted, felt = arm_env.task_values(tick)[-2], seen.contact_force[0] @ arm_env.normal
        self.touched |= felt > 0.2
        if self.touched:
            self.sum += 20.0 * plant.sample_time * (wanted - felt)
        push = wanted + self.sum if self.touched else 1.0
        straight = arm.rest(seen.joint_angle)
        turned = [arm.tip_velocity(straight, arm.rest(unit))[:2] for unit in np.eye(arm.n_joints)]
        torque = [60.0, 15.0] * (angle - seen.joint_angle) + [12.0, 3.0] * (rate - seen.joint_rate)
        torque -= push * np.array(turned) @ arm_env.normal
        return (torque / arm_env.torque_limit).clip(-1.0, 1.0).astype(np.float32)


def episode(env, policy, seed=0, **options):
    """Return observations, rewards and infos of an episode."""
    observation, _ = env.reset(seed=seed, **options)
    observations, rewards, infos, over = [observation], [], [], False
    while not over:
        observation, reward, terminated, truncated, info = env.step(policy(env.unwrapped))
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        over = terminated or truncated
    return np.array(observations), np.array(rewards), infos


def still(arm_env):
    return np.zeros(arm_env.arm.n_joints, np.float32)


@pytest.mark.thorough
def test_a_simple_force_controller_succeeds_where_zero_torque_fails():
    env = gymnasium.make(FORCE)
    for seed in range(3):
        _, rewards, infos = episode(env, Pressing(), seed)
        _, lazy, idle = episode(env, still, seed)
        assert rewards.sum() > 2.0 * lazy.sum()
        assert infos[-1]["is_success"]
        assert not idle[-1]["is_success"]
        assert idle[-1]["force"] == pytest.approx(0.0, abs=1e-6)
        # The tip stays in contact with the wall.
        sliding = [info["force"] for info in infos if 1.0 < info["time"] < 2.5]
        assert min(sliding) > 2.0
        assert max(sliding) < 8.5
        wanted = [5.0 - 2.0 * np.cos(np.pi * info["time"]) for info in infos]
        reported = [info["force"] - info["force_error"] for info in infos]
        np.testing.assert_allclose(reported, wanted, rtol=0, atol=1e-12)


@pytest.mark.sampled("law0")
@pytest.mark.parametrize(
    "law",
    [
        {"stiffness": 1e4, "damping": 0.5, "exponent": 1.0},
        {"stiffness": 4e5, "damping": 2.0, "exponent": 1.5},
    ],
)
def test_observed_force_follows_the_contact_law(law):
    """The force is k d^n (1 + a v) along the normal, and friction times that along the wall.

    It is computed at the exact position of the tip and compared at every sample time from the first
    contact, where v is large, to the end.
    """
    env = gymnasium.make(FORCE, duration=1.5, **law)
    policy, compared, fastest = Pressing(), 0, 0.0
    observation, info = env.reset(seed=4)
    arm_env = env.unwrapped
    columns = [arm_env.observation_names.index(f"contact_force[{axis}] (N)") for axis in "xy"]
    normal, start = arm_env.normal, arm_env.motion.start
    tangent = np.array([-normal[1], normal[0]])
    while info["time"] < 1.5 - 1e-9:
        observation, *_, info = env.step(policy(arm_env))
        tip, velocity = arm_env.plant.tip[:2], arm_env.plant.tip_velocity[:2]
        depth, speed = normal @ (start - tip), -normal @ velocity
        slide = tangent @ velocity
        seen = observation[columns].astype(float)
        if depth < 1e-6:  # the law is smoothed over nanometres at the surface
            assert np.abs(seen).max() < law["stiffness"] * 1.1e-6 ** law["exponent"] * 2.0
            continue
        push = law["stiffness"] * depth ** law["exponent"] * (1.0 + law["damping"] * speed)
        wanted = push * normal - 0.2 * push * np.tanh(slide / 1e-3) * tangent
        # Observations have single precision.
        np.testing.assert_allclose(seen, wanted, rtol=0, atol=3e-7 * push + 1e-9)
        # The corner of the law is rounded over a billionth of the reach.
        assert info["force"] == pytest.approx(push, rel=1e-8)
        compared, fastest = compared + 1, max(fastest, law["damping"] * abs(speed))
    assert compared > 200
    assert fastest > 0.02  # the damping has an effect


@pytest.mark.thorough
def test_random_walls_face_the_base_and_are_within_the_torque_limits():
    env = gymnasium.make(FORCE)
    places = []
    for seed in range(20):
        observation, info = env.reset(seed=seed)
        arm_env = env.unwrapped
        motion, normal = arm_env.motion, arm_env.normal
        way = motion.end - motion.start
        assert np.hypot(*normal) == pytest.approx(1.0)
        assert way @ normal == pytest.approx(0.0, abs=1e-12)
        assert np.hypot(*way) == pytest.approx(0.125 * REACH)
        assert (motion.start_time, motion.end_time) == (0.5, 2.5)
        toward = -motion.start / np.hypot(*motion.start)
        assert np.arccos(normal @ toward) <= np.pi / 6 + 1e-9
        for s in np.linspace(0.0, 1.0, 5):
            assert 0.5 * REACH <= np.hypot(*(motion.start + s * way)) <= 0.85 * REACH
        # The arm starts at rest, 5 mm in front of the wall, without contact.
        assert normal @ (info["tip"] - motion.start) == pytest.approx(0.005, abs=1e-9)
        assert info["force"] == pytest.approx(0.0, abs=1e-6)
        places.append([*motion.start, *normal])
        # The torque that balances the largest force at rest is a part of the torque limits.
        arm = arm_env.arm
        for t in np.linspace(0.5, 2.5, 5):
            q, none = arm.rest(motion.joint_angle(t)), np.zeros(arm.dof)
            pushed = arm.inverse_dynamics(q, none, none, tip_force=7.0 * normal)
            held = np.array([pushed[k] for k in np.flatnonzero(arm.rest(np.ones(2)))])
            assert np.all(abs(held) <= 0.4 * arm_env.torque_limit + 1e-9)
        names = dict(zip(arm_env.observation_names, observation, strict=True))
        assert names["wall_normal[x] (1)"] == pytest.approx(normal[0], rel=1e-6)
        assert names["wanted_force[1] (N)"] == pytest.approx(3.0)
        assert names["wanted_force_rate[1] (N/s)"] == 0.0
    assert len(np.unique(places, axis=0)) == 20


def test_stiffness_friction_and_place_are_random_or_fixed():
    env = gymnasium.make(FORCE, stiffness=[3e3, 3e4], friction=[0.0, 0.4], place=0.003)
    arm_env, drawn = env.unwrapped, []
    for seed in (0, 1, 2, 0):
        _, info = env.reset(seed=seed)
        (wall,) = arm_env.contacts()
        assert 3e3 <= wall.stiffness <= 3e4
        assert 0.0 <= wall.friction <= 0.4
        off = arm_env.normal @ (wall.surface.point - arm_env.motion.start)
        assert abs(off) <= 0.003
        # In front of the actual wall, nearer or farther than the believed one.
        gap = arm_env.normal @ (info["tip"] - wall.surface.point)
        assert 0.005 - 1e-9 <= gap <= 0.008 + 1e-9
        drawn.append([wall.stiffness, wall.friction, off])
    assert drawn[0] == drawn[3]
    assert np.all(np.ptp(drawn[:3], axis=0) > 0.0)
    fixed = {"start": (1.5, 0.5), "end": (1.5, 0.8), "stiffness": 2e4, "friction": 0.1}
    _, info = env.reset(options={**fixed, "place": -0.002})
    (wall,) = arm_env.contacts()
    assert (wall.stiffness, wall.friction) == (2e4, 0.1)
    np.testing.assert_allclose(arm_env.normal, [-1.0, 0.0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(wall.surface.point, [1.502, 0.5], rtol=0, atol=1e-15)
    np.testing.assert_allclose(info["tip"], [1.495, 0.5], rtol=0, atol=1e-12)


def test_plant_hardware_and_force_can_be_chosen():
    """A heavier plant meets the same wall, and the given instruments determine the observations."""
    spec = laboratory_arm().spec

    def heavier(rng):
        load = fa.Payload(mass=rng.uniform(0.1, 0.5))
        return fa.Arm(links=spec.links, joints=spec.joints, payload=load)

    sensors = [fa.Instrument("joint_angle", rate_cutoff=80.0)]
    felt = fa.Instrument("contact_force", name="felt", noise=0.05, delay=0.005)
    hardware = fa.Hardware([*sensors, felt])
    env = gymnasium.make(FORCE, plant=heavier, hardware=hardware, force=(3.0, 1.0), duration=1.0)
    names = env.unwrapped.observation_names
    assert "felt[y] (N)" in names
    assert not any("tip_velocity" in name for name in names)
    observations, _, infos = episode(env, still, seed=2)
    assert all(observation in env.observation_space for observation in observations)
    assert env.unwrapped.plant.arm.spec.payload.mass > 0.1
    assert infos[-1]["force_error"] == pytest.approx(-(3.0 - np.cos(np.pi * 1.0)), abs=1e-6)
    blind = gymnasium.make(FORCE, hardware=fa.Hardware(sensors))
    assert not any("force[x]" in name for name in blind.unwrapped.observation_names)
    # Readings have noise and delay; the values of info are exact.
    assert observations[:, names.index("felt[x] (N)")].std() == pytest.approx(0.05, rel=0.3)


def test_reward_is_positive_at_any_force():
    """Otherwise an agent would gain by ending an episode."""
    env = gymnasium.make(FORCE)
    env.reset(seed=0)
    worst = {"distance": 2.0 * REACH, "force_error": 1e6}
    assert 1.0 / (1.0 + env.unwrapped.miss(worst)) > 0.002
    assert env.unwrapped.miss({"distance": 0.0, "force_error": -1.0}) == 1.0
    assert env.unwrapped.miss({"distance": 0.02 * REACH, "force_error": 0.0}) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"force": (2.0, 3.0)}, "force must be \\(mean, amplitude\\)"),
        ({"force": (90.0, 20.0)}, "a sum of at most 100"),
        ({"force": 5.0}, "force must be"),
        ({"period": 0.0}, "period must be greater than 0"),
        ({"stiffness": -1.0}, "stiffness must be greater than 0"),
        ({"stiffness": (2e4, 1e4)}, "stiffness must be greater than 0, with the lower bound first"),
        ({"friction": (0.1, 0.2, 0.3)}, "friction must be"),
        ({"place": -0.1}, "place must be at least 0"),
        ({"damping": -1.0}, "damping must be at least 0"),
        ({"exponent": 0.5}, "exponent must be at least 1, got 0.5"),
    ],
    ids=str,
)
def test_wrong_arguments_are_rejected(arguments, message):
    with pytest.raises(fa.InputError, match=message):
        ENVIRONMENTS[FORCE](**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"start": (1.5, 0.5)}, "need both 'start' and 'end', or neither"),
        ({"start": (1.5, 0.5), "end": (1.5, 0.5, 0.0)}, "end must be"),
        ({"start": (1.5, 0.5), "end": (4.0, 0.5)}, "out of reach|reach"),
        ({"stiffness": -1.0}, "stiffness must be greater than 0"),
        ({"place": np.nan}, "place must be"),
        ({"duration": 1.0}, "an option must be one of 'start', 'end', 'stiffness'"),
    ],
    ids=str,
)
def test_wrong_options_are_rejected(options, message):
    env = ENVIRONMENTS[FORCE]()
    with pytest.raises(fa.InputError, match=message):
        env.reset(seed=0, options=options)


def test_an_arm_that_cannot_press_is_rejected():
    env = ENVIRONMENTS[FORCE](torque_limit=0.1)
    with pytest.raises(fa.InputError, match=r"the arm cannot press on any of .*torque limit"):
        env.reset(seed=0)
