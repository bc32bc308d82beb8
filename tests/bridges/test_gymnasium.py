"""The environments pass Gymnasium's checker and keep the contract of their documentation."""

import importlib
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import flexarm as fa
import flexarm.bridges.gymnasium_env as bridge
from flexarm.bridges.gymnasium_env import ENVIRONMENTS, laboratory_arm

every = pytest.mark.parametrize("name", ENVIRONMENTS)
REACH, TRACK, FORCE = "flexarm/Reach-v0", "flexarm/TrackPath-v0", "flexarm/TrackForce-v0"


def episode(env, policy, seed=0, **options):
    """Return observations, rewards, infos and the end (terminated, truncated) of an episode."""
    observation, info = env.reset(seed=seed, **options)
    observations, rewards, infos = [observation], [], [info]
    terminated = truncated = False
    while not (terminated or truncated):
        observation, reward, terminated, truncated, info = env.step(policy(env, info))
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
    return np.array(observations), np.array(rewards), infos, (terminated, truncated)


def still(env, info):
    return np.zeros(env.action_space.shape, np.float32)


def joint_pd(env, info):
    """Return the action of joint PD along the motion that the task plans for the joints."""
    arm_env = env.unwrapped
    seen = arm_env.plant.measurement
    if isinstance(arm_env, ENVIRONMENTS[REACH]):
        angle, rate = arm_env.goal_angle, 0.0
    else:
        angle, rate, _ = arm_env.motion.state(info["time"])
    torque = [40.0, 10.0] * (angle - seen.joint_angle) + [20.0, 1.5] * (rate - seen.joint_rate)
    return (torque / arm_env.torque_limit).clip(-1.0, 1.0).astype(np.float32)


@pytest.mark.thorough_cases("flexarm/TrackForce-v0", "flexarm/TrackPath-v0")
@every
def test_environments_pass_the_checker_of_gymnasium(name):
    """The suite turns warnings into errors."""
    check_env(gymnasium.make(name).unwrapped)


@every
def test_a_step_before_the_first_reset_is_rejected(name):
    env = gymnasium.make(name).unwrapped
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"reset\(\) before step"):
        env.step(np.zeros(2, np.float32))


@pytest.mark.thorough_cases("flexarm/TrackForce-v0")
@every
def test_same_seed_gives_the_same_episode(name):
    env = gymnasium.make(name, duration=0.3)
    noisy = gymnasium.make(name, duration=0.3, hardware=fa.Hardware(instruments(noise=1e-3)))
    for one in (env, noisy):
        runs = [episode(one, sampled(one), seed=seed) for seed in (4, 4, 5)]
        np.testing.assert_array_equal(runs[0][0], runs[1][0])
        np.testing.assert_array_equal(runs[0][1], runs[1][1])
        assert np.any(runs[0][0] != runs[2][0])
    # Each episode has its own noise, so readings of the same task differ.
    options = {
        REACH: {"start": [0.3, 0.4], "goal": [0.5, 0.1]},
        TRACK: {"start": [2.0, 0.5], "end": [1.5, 1.0], "duration": 1.0},
        FORCE: {"start": [1.5, 0.5], "end": [1.5, 0.8]},
    }[name]
    first = noisy.reset(seed=1, options=options)[0]
    assert np.any(noisy.reset(options=options)[0] != first)


def instruments(noise):
    return [
        fa.Instrument("joint_angle", rate_cutoff=50.0),
        fa.Instrument("tip", name="camera", noise=noise),
        fa.Instrument(fa.Sensor("acceleration", 2, frame="link"), name="accelerometer", limit=40.0),
    ]


def sampled(env):
    env.action_space.seed(3)
    return lambda env, info: env.action_space.sample()


@every
def test_observations_are_in_their_space_and_have_unique_names(name):
    # A rigid arm does not bend; it turns faster than the bounds of the space.
    arm = laboratory_arm().rigid()
    env = gymnasium.make(name, duration=1.0, arm=arm, torque_limit=500.0)
    full = np.array([1.0, 1.0], np.float32)
    observations, *_ = episode(env, lambda env, info: full)
    assert all(observation in env.observation_space for observation in observations)
    assert abs(observations[:, 4:6]).max() == 50.0
    names = env.unwrapped.observation_names
    assert len(names) == len(set(names)) == observations.shape[1]
    assert names[:4] == [f"{f} joint_angle[{k}] (1)" for f in ("cos", "sin") for k in (1, 2)]


@every
def test_observations_have_the_values_that_their_names_state(name):
    env = gymnasium.make(name)
    info = env.reset(seed=2)[1]
    for _ in range(100):
        info = env.step(joint_pd(env, info))[-1]
    arm_env = env.unwrapped
    plant, arm = arm_env.plant, arm_env.arm
    observation = arm_env.step(np.array([0.5, -0.5]))[0]
    seen = dict(zip(arm_env.observation_names, observation, strict=True))
    wanted = {
        "cos joint_angle[2] (1)": np.cos(arm.joint_angles(plant.q)[1]),
        "sin joint_angle[1] (1)": np.sin(arm.joint_angles(plant.q)[0]),
        "joint_rate[1] (rad/s)": arm.joint_angles(plant.qd)[0],
        "strain[2] (1e-3)": 1e3 * arm.strain(plant.q)[1],
        "tip[x] (m)": plant.tip[0],
        "tip_velocity[y] (m/s)": plant.tip_velocity[1],
    }
    if name == REACH:
        wanted["goal[y] (m)"] = arm.tip(arm.rest(info["goal_joint_angle"]))[1]
    else:
        motion, t = arm_env.motion, plant.time
        rates = arm.tip_velocity(arm.rest(motion.joint_angle(t)), arm.rest(motion.joint_rate(t)))
        wanted["wanted_tip[x] (m)"] = motion.tip(t)[0]
        wanted["wanted_velocity[y] (m/s)"] = rates[1]
        wanted["line_end[x] (m)"] = motion.end[0]
        wanted["time_left[1] (s)"] = motion.end_time - t
    for key, value in wanted.items():
        assert seen[key] == pytest.approx(value, rel=2e-7, abs=2e-7), key  # single precision


@every
def test_a_step_simulates_one_sample_time_with_a_constant_torque(name):
    env = gymnasium.make(name, sample_time=0.01, duration=0.2)
    env.reset(seed=7)
    q = env.unwrapped.plant.q
    # small enough for the bending limit
    actions = [0.5 * env.action_space.sample() for _ in range(20)]
    actions[3] = np.array([5.0, -7.0], np.float32)  # clipped to the torque limits
    torques = []
    for action in actions:
        info = env.step(action)[-1]
        torques.append(info["torque"])
    limit = {FORCE: [20.0, 12.0]}.get(name, [10.0, 3.0])
    np.testing.assert_allclose(torques[3], [limit[0], -limit[1]])
    np.testing.assert_allclose(torques[0], actions[0] * limit, rtol=1e-6)
    result = fa.simulate(
        laboratory_arm(),
        0.2,
        torque=np.array(torques),
        rate=100.0,
        torque_interpolation="hold",
        initial=q,
        contacts=env.unwrapped.contacts(),
        rtol=1e-7,
    )
    # Both stop at every sample time, so the difference is rounding.
    np.testing.assert_allclose(env.unwrapped.plant.q, result.q.values[-1], rtol=0, atol=1e-12)
    assert info["time"] == pytest.approx(0.2)
    assert env.metadata["render_fps"] == 100


@every
def test_an_episode_ends_at_its_duration_with_the_documented_rewards(name):
    env = gymnasium.make(name, duration=1.0)
    _, rewards, infos, ended = episode(env, joint_pd, seed=3)
    assert ended == (False, True)
    assert len(rewards) == 200
    scale = {REACH: 0.05, TRACK: 0.02, FORCE: 0.02}[name] * 2.4142
    for reward, info in zip(rewards, infos[1:], strict=True):
        effort = np.mean((info["torque"] / env.unwrapped.torque_limit) ** 2)
        of_force = abs(info.get("force_error", 0.0)) / 1.0  # N, a fifth of 5 N
        wanted = 1.0 / (1.0 + info["distance"] / scale + of_force) - 0.002 * effort
        assert reward == pytest.approx(wanted, rel=1e-12)
    distance = np.hypot(*(infos[-1]["tip"] - env.unwrapped.target(200)))
    assert infos[-1]["distance"] == pytest.approx(distance)


@pytest.mark.thorough
@pytest.mark.parametrize("name", [REACH, TRACK])
def test_joint_pd_succeeds_where_zero_torque_fails(name):
    env = gymnasium.make(name)
    for seed in range(3):
        _, rewards, infos, _ = episode(env, joint_pd, seed=seed)
        _, lazy, idle, _ = episode(env, still, seed=seed)
        assert infos[-1]["is_success"]
        assert not idle[-1]["is_success"]
        assert rewards.sum() > 2.0 * lazy.sum()
        assert lazy.min() > 0.0


@every
def test_excessive_bending_ends_the_episode_with_zero_reward(name):
    env = gymnasium.make(name, torque_limit=200.0)
    full = np.array([1.0, -1.0], np.float32)
    _, rewards, infos, ended = episode(env, lambda env, info: full)
    assert ended == (True, False)
    assert "deflects by up to" in infos[-1]["reason"]
    assert rewards[-1] == 0.0
    assert np.all(rewards[:-1] > 0.0)
    assert not infos[-1]["is_success"]


@every
def test_a_failed_simulation_ends_the_episode_with_zero_reward(name, monkeypatch):
    env = gymnasium.make(name)
    env.reset(seed=1)
    first = env.step(still(env, {}))

    def fail(torque):
        raise fa.SimulationError(0.005, "the state is no longer finite.")

    monkeypatch.setattr(env.unwrapped.plant, "step", fail)
    observation, reward, terminated, truncated, info = env.step(still(env, {}))
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert info["reason"] == "stopped at t = 0.005 s: the state is no longer finite."
    np.testing.assert_array_equal(observation, first[0])


def test_goals_are_within_the_limits_of_the_joints():
    limits = fa.JointLimits(lower=-0.5, upper=0.7, stiffness=100.0)
    spec = laboratory_arm().spec
    stopped = fa.Arm(
        links=spec.links, joints=[spec.joints[0].replace(limits=limits), spec.joints[1]]
    )
    env = gymnasium.make(REACH, arm=stopped, torque_limit=5.0)
    for seed in range(50):
        _, info = env.reset(seed=seed)
        start, goal = env.unwrapped.plant.measurement.joint_angle, info["goal_joint_angle"]
        assert -0.5 <= start[0] <= 0.7
        assert -0.5 <= goal[0] <= 0.7
        assert np.all(abs(goal - start) <= 0.6)
        assert np.all(abs(goal) <= 2.5)


def test_lines_are_random_or_given_by_options():
    env = gymnasium.make(TRACK)
    lines = []
    for seed in range(5):
        env.reset(seed=seed)
        motion = env.unwrapped.motion
        lines.append([*motion.start, *motion.end])
        length = np.hypot(*(motion.end - motion.start)) / 2.4142
        assert 0.15 <= length <= 0.4
        assert 0.2 <= length / motion.duration <= 0.4
    assert len(np.unique(lines, axis=0)) == 5
    options = {"start": (2.0, 1.0), "end": (1.0, 2.0), "duration": 1.0}
    _, info = env.reset(options=options)
    np.testing.assert_allclose(info["tip"], [2.0, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(env.unwrapped.motion.end, [1.0, 2.0])


def test_a_plant_function_gives_each_episode_an_arm():
    spec = laboratory_arm().spec

    def draw(rng):
        load = fa.Payload(mass=rng.uniform(0.0, 0.5))
        return fa.Arm(links=spec.links, joints=spec.joints, payload=load)

    env = gymnasium.make(REACH, plant=draw)
    masses = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        masses.append(env.unwrapped.plant.arm.spec.payload.mass)
    assert masses[0] == masses[2] != masses[1]
    assert env.unwrapped.arm.spec.payload is laboratory_arm().spec.payload


def test_hardware_determines_observations_and_torque_limits():
    motors = fa.Motors(torque_limit=[2.0, 1.0], delay=0.002)
    hardware = fa.Hardware(instruments(noise=0.0), motors)
    env = gymnasium.make(REACH, hardware=hardware, arm=laboratory_arm())
    names = env.unwrapped.observation_names
    assert "camera[x] (m)" in names
    assert "joint_rate[2] (rad/s)" in names
    assert "accelerometer[1] (SI)" in names
    assert not any("strain" in name for name in names)
    np.testing.assert_array_equal(env.unwrapped.torque_limit, [2.0, 1.0])
    check_env(env.unwrapped)
    lag = fa.Hardware(motors=fa.Motors(time_constant=0.001))
    np.testing.assert_array_equal(
        gymnasium.make(REACH, hardware=lag).unwrapped.torque_limit, [10, 3]
    )


@every
def test_rendered_pictures_show_the_motion(name):
    env = gymnasium.make(name, render_mode="rgb_array")
    env.reset(seed=1)
    before = env.render()
    assert before.shape == (480, 480, 3)
    assert before.dtype == np.uint8
    for _ in range(20):
        env.step(np.array([1.0, -1.0], np.float32))
    after = env.render()
    blue = [np.all(image == (0x00, 0x72, 0xB2), axis=2) for image in (before, after)]
    assert 500 < blue[1].sum() < 20000
    assert (blue[0] != blue[1]).sum() > 100
    env.close()
    env.close()


@every
def test_vectorized_environments_equal_single_ones(name):
    """Gymnasium's own vector environment; its members share no state."""
    together = gymnasium.make_vec(name, num_envs=2, vectorization_mode="sync", duration=0.2)
    observations, _ = together.reset(seed=[3, 9])
    singles = [gymnasium.make(name, duration=0.2) for _ in range(2)]
    alone = [env.reset(seed=seed)[0] for env, seed in zip(singles, (3, 9), strict=True)]
    np.testing.assert_array_equal(observations, alone)
    together.action_space.seed(1)
    for _ in range(40):
        actions = together.action_space.sample()
        observations, rewards, _, truncated, _ = together.step(actions)
        steps = [env.step(action) for env, action in zip(singles, actions, strict=True)]
        np.testing.assert_array_equal(observations, [step[0] for step in steps])
        np.testing.assert_array_equal(rewards, [step[1] for step in steps])
    assert np.all(truncated)
    together.close()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"arm": "arm"}, "ReachEnv: arm must be an Arm"),
        ({"plant": 3}, "ReachEnv: plant must be an Arm, or a function"),
        (
            {"plant": fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])},
            "plant must have 2 joints and 2 gauges",
        ),
        ({"sample_time": 0.0}, "sample_time must be greater than 0"),
        ({"duration": 0.0}, "duration must be at least sample_time"),
        ({"torque_limit": [1.0, -1.0]}, "torque_limit must be greater than 0"),
        ({"torque_limit": [1.0, 1.0, 1.0]}, "torque_limit"),
        ({"arm": laboratory_arm()}, "torque_limit is required with an arm"),
        ({"hardware": "encoder"}, "hardware must be a Hardware object"),
        ({"render_mode": "human"}, "render_mode must be 'rgb_array' or None"),
    ],
    ids=str,
)
def test_wrong_arguments_are_rejected(arguments, message):
    with pytest.raises(fa.InputError, match=message):
        ENVIRONMENTS[REACH](**arguments)


def test_wrong_options_and_actions_are_rejected():
    env = ENVIRONMENTS[REACH]()
    env.reset(seed=0)
    with pytest.raises(fa.InputError, match="an option must be one of 'start', 'goal'"):
        env.reset(options={"aim": [0.0, 0.0]})
    with pytest.raises(fa.InputError, match="goal must be numbers of shape"):
        env.reset(options={"goal": [0.0]})
    with pytest.raises(fa.InputError, match="action"):
        env.step(np.array([np.nan, 0.0]))
    with pytest.raises(fa.InputError, match="have no 'end' and no 'duration'"):
        ENVIRONMENTS[TRACK]().reset(options={"start": (2.0, 1.0)})
    stiff = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    with pytest.raises(fa.InputError, match="cannot follow any of"):
        ENVIRONMENTS[TRACK](arm=stiff, torque_limit=1.0).reset(seed=0)


def test_without_gymnasium_the_error_names_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    with pytest.raises(ImportError, match=r"pip install 'flexarm\[gym\]'"):
        importlib.reload(bridge)


def test_changes_happen_in_every_episode_and_may_be_drawn():
    pick = fa.Change("payload.mass", at=0.05, to=0.5)

    def draw(rng):
        return [pick.replace(to=float(rng.uniform(0.3, 0.6)))]

    push = lambda env, info: np.full(2, 0.5, np.float32)  # noqa: E731
    options = {"sample_time": 0.01, "duration": 0.2}
    plain = episode(gymnasium.make(REACH, **options), push)[0]
    env = gymnasium.make(REACH, changes=[pick], **options)
    first, again = episode(env, push)[0], episode(env, push)[0]
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[:6], plain[:6])  # the sixth reading is before the change
    assert abs(first[7:] - plain[7:]).max() > 1e-3
    drawn = gymnasium.make(REACH, changes=draw, **options)
    one, other, same = (episode(drawn, push, seed=seed)[0] for seed in (1, 2, 1))
    np.testing.assert_array_equal(one, same)
    assert abs(one[-1] - other[-1]).max() > 1e-3
