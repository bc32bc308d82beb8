"""Vector environments equal single ones, for any number of sub-environments and threads."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.passive_env_checker import check_obs, check_space
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import flexarm as fa
from flexarm.bridges.gymnasium_env import VECTOR_ENVIRONMENTS, laboratory_arm
from flexarm.simulation.batch.closed_lanes import LanePlants

every = pytest.mark.parametrize("name", VECTOR_ENVIRONMENTS)
REACH, FORCE = "flexarm/Reach-v0", "flexarm/TrackForce-v0"
MODES = [mode.value for mode in AutoresetMode]


class Single(gymnasium.Env):
    """Vector environment with one sub-environment in the form of a single environment."""

    def __init__(self, envs):
        self.envs = envs
        self.observation_space = envs.single_observation_space
        self.action_space = envs.single_action_space
        self.metadata, self.render_mode = envs.metadata, envs.render_mode

    @staticmethod
    def _first(info):
        return {key: value[0] for key, value in info.items() if not key.startswith("_")}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        observation, info = self.envs.reset(seed=seed, options=options)
        self._np_random = self.envs.np_random[0]
        return observation[0], self._first(info)

    def step(self, action):
        observation, reward, terminated, truncated, info = self.envs.step(action[None])
        ended = bool(terminated[0]), bool(truncated[0])
        return observation[0], float(reward[0]), *ended, self._first(info)

    def render(self):
        return self.envs.render()[0]


def actions_of(envs, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1.1, 1.1, (steps, *envs.action_space.shape))


def assert_same_info(found, wanted):
    """Compare the items that the masks mark."""
    assert {k for k in found if not k.startswith("_")} == {
        k for k in wanted if not k.startswith("_")
    }
    for key in wanted:
        if key.startswith("_"):
            np.testing.assert_array_equal(found[key], wanted[key], err_msg=key)
            continue
        if isinstance(wanted[key], dict):
            assert_same_info(found[key], wanted[key])
            continue
        mask = wanted[f"_{key}"]
        for one, other in zip(found[key][mask], wanted[key][mask], strict=True):
            # The sums of a single environment and of arrays differ in the order of their terms.
            if isinstance(other, str):
                assert one == other
            else:
                np.testing.assert_allclose(one, other, rtol=1e-13, atol=1e-14, err_msg=key)


@pytest.mark.sampled("bent-NextStep-flexarm/Reach-v0")
@every
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("torque_limit", [[10.0, 3.0], [120.0, 60.0]], ids=["whole", "bent"])
def test_sub_environments_equal_single_environments(name, mode, torque_limit):
    """With the large torques, links bend too far, and episodes end at different times."""
    arguments = {"num_envs": 5, "duration": 0.1, "torque_limit": torque_limit}
    fast = gymnasium.make_vec(name, autoreset_mode=mode, threads=2, **arguments)
    slow = gymnasium.make_vec(
        name, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **arguments
    )
    seed = [3, 9, 4, 5, 7]
    (seen, info), (other, other_info) = fast.reset(seed=seed), slow.reset(seed=seed)
    np.testing.assert_array_equal(seen, other)
    assert_same_info(info, other_info)
    assert fast.np_random_seed == tuple(seed)
    ended = set()
    for action in actions_of(fast, 45):
        found, wanted = fast.step(action), slow.step(action)
        # Observations have single precision, in which both have the same numbers.
        np.testing.assert_array_equal(found[0], wanted[0])
        np.testing.assert_allclose(found[1], wanted[1], rtol=1e-13, atol=0)
        for k in (2, 3):
            np.testing.assert_array_equal(found[k], wanted[k])
            assert found[k].dtype == np.bool_
        assert_same_info(found[4], wanted[4])
        over = found[2] | found[3]
        ended |= {(bool(a), bool(b)) for a, b in zip(found[2], found[3], strict=True)}
        if mode == "Disabled" and over.any():
            with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
                fast.step(action)
            found = fast.reset(options={"reset_mask": over})
            wanted = slow.reset(options={"reset_mask": over})
            np.testing.assert_array_equal(found[0], wanted[0])
            assert_same_info(found[1], wanted[1])
    bent = torque_limit[0] > 100.0
    assert ((True, False) in ended) == bent
    assert bent or (False, True) in ended
    fast.close()
    slow.close()


@pytest.mark.sampled("flexarm/Reach-v0")
@every
def test_numbers_do_not_depend_on_the_number_of_environments_and_threads(name):
    def history(count, threads):
        envs = gymnasium.make_vec(name, num_envs=count, threads=threads, duration=0.1)
        found = [envs.reset(seed=20)[0][:3]]
        for action in actions:
            observations, rewards, *_, info = envs.step(action[:count])
            found += [observations[:3], rewards[:3], info["tip"][:3], info["speed"][:3]]
        envs.close()
        return found

    actions = np.random.default_rng(1).uniform(-1.0, 1.0, (25, 19, 2))
    few = history(3, 1)
    for other in (history(19, 1), history(19, 3)):
        for one, same in zip(few, other, strict=True):
            np.testing.assert_array_equal(one, same)


@every
def test_vector_environments_pass_the_checkers_of_gymnasium(name):
    """The suite turns warnings into errors."""
    one = gymnasium.make_vec(name, autoreset_mode="Disabled", render_mode="rgb_array")
    check_env(Single(one), skip_render_check=True)  # it needs an environment of the registry
    envs = gymnasium.make_vec(name, num_envs=9, threads=1)
    for kind in ("observation", "action"):
        space = getattr(envs, f"{kind}_space")
        check_space(space, kind, lambda _: None)
        batched = gymnasium.vector.utils.batch_space(getattr(envs, f"single_{kind}_space"), 9)
        assert space == batched
    observations, _ = envs.reset(seed=1)
    check_obs(observations, envs.observation_space, "reset")
    kept = observations.copy()
    envs.action_space.seed(2)
    stepped = envs.step(envs.action_space.sample())
    check_obs(stepped[0], envs.observation_space, "step")
    np.testing.assert_array_equal(observations, kept)  # no array is used again
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.observation_names == one.observation_names
    envs.reset(seed=1)
    envs.action_space.seed(2)
    assert data_equivalence(stepped, envs.step(envs.action_space.sample()), exact=True)


def test_wrappers_of_gymnasium_count_episodes():
    envs = gymnasium.make_vec(REACH, num_envs=4, duration=0.05)
    counted = RecordEpisodeStatistics(envs)
    counted.reset(seed=0)
    lengths = []
    for action in actions_of(envs, 33):
        info = counted.step(action)[-1]
        if "episode" in info:
            lengths += info["episode"]["l"][info["_episode"]].tolist()
    assert lengths == [10] * 12  # a step of each episode of 11 begins the next one


def test_options_and_random_seeds():
    envs = gymnasium.make_vec(REACH, num_envs=3)
    options = {"start": [0.3, 0.4], "goal": [0.5, 0.1]}
    observations, info = envs.reset(options=options)
    np.testing.assert_array_equal(observations, np.tile(observations[:1], (3, 1)))
    np.testing.assert_allclose(info["goal_joint_angle"], np.tile([0.5, 0.1], (3, 1)))
    assert len(set(envs.np_random_seed)) == 3
    first, second = envs.reset(seed=4)[0], envs.reset()[0]
    assert np.all(np.any(first != second, axis=1))
    assert envs.np_random_seed == (4, 5, 6)
    np.testing.assert_array_equal(envs.reset(seed=[6, None, 4])[0][[2, 0]], first[[0, 2]])


def test_another_plant_than_the_nominal_arm_is_simulated():
    spec = laboratory_arm().spec
    heavy = fa.Arm(links=spec.links, joints=spec.joints, payload=fa.Payload(mass=0.5))
    fast = gymnasium.make_vec(REACH, num_envs=2, plant=heavy)
    slow = gymnasium.make_vec(REACH, num_envs=2, plant=heavy, vectorization_mode="sync")
    np.testing.assert_array_equal(fast.reset(seed=0)[0], slow.reset(seed=0)[0])
    for action in actions_of(fast, 5):
        np.testing.assert_array_equal(fast.step(action)[0], slow.step(action)[0])


def test_rendered_pictures_are_those_of_single_environments():
    fast = gymnasium.make_vec("flexarm/TrackPath-v0", num_envs=2, render_mode="rgb_array")
    slow = gymnasium.make_vec(
        "flexarm/TrackPath-v0", num_envs=2, render_mode="rgb_array", vectorization_mode="sync"
    )
    for envs in (fast, slow):
        envs.reset(seed=3)
        envs.step(np.ones((2, 2), np.float32))
    pictures = fast.render()
    for picture, wanted in zip(pictures, slow.render(), strict=True):
        np.testing.assert_array_equal(picture, wanted)
    assert np.any(pictures[0] != pictures[1])


@every
def test_a_failed_simulation_ends_only_its_own_episode(name):
    envs = gymnasium.make_vec(name, num_envs=9)
    returned, _ = envs.reset(seed=0)
    before = returned.copy()
    returned[...] = 7.0  # the caller may change it
    other = gymnasium.make_vec(name, num_envs=9)
    other.reset(seed=0)
    envs._plants.state[4, 1, 0, 0] = 1e200
    action = actions_of(envs, 1)[0]
    found, wanted = envs.step(action), other.step(action)
    assert found[2].tolist() == [k == 4 for k in range(9)]
    assert found[1][4] == 0.0
    assert found[4]["reason"][4].startswith("stopped at t = 0 s: ")
    np.testing.assert_array_equal(found[0][4], before[4])
    rest = np.arange(9) != 4
    np.testing.assert_array_equal(found[0][rest], wanted[0][rest])
    np.testing.assert_array_equal(found[1][rest], wanted[1][rest])
    again = envs.step(action)
    assert again[4]["time"][4] == 0.0
    assert not again[2].any()


def test_plants_equal_a_single_plant_to_the_last_bit():
    """Also with an arm so stiff that the method is implicit in bending."""
    soft, joints = laboratory_arm(), laboratory_arm().spec.joints
    links = [
        fa.Link(length=1.0, flexural_rigidity=rigidity, mass_per_length=1.0, elements=2)
        for rigidity in (10.0, 1e9)
    ]
    stiff = fa.Arm(links=links, joints=joints)
    methods = []
    for arm in (soft, stiff):
        plants = LanePlants(arm, 10, 0.005, threads=2)
        angles = np.random.default_rng(2).uniform(-1.0, 1.0, (10, 2))
        places = np.arange(10)
        plants.start(places, np.array([arm.rest(one) for one in angles]))
        torques = np.random.default_rng(3).uniform(-0.2, 0.2, (4, 10, 2))
        for torque in torques:
            assert plants.step(places, torque) == {}
        for k in (0, 9):
            plant = fa.Plant(arm, 0.005)
            plant.reset(arm.rest(angles[k]))
            for torque in torques:
                plant.step(torque[k])
            np.testing.assert_array_equal(arm.unpadded(plants.state[k])[0], plant.q)
            np.testing.assert_array_equal(arm.unpadded(plants.state[k])[1], plant.qd)
            assert plants.time[k] == plant.time
        methods += [method.name for method in plants._methods]
        plants.close()
    assert methods == ["dormand_prince_8", "kennedy_carpenter_5"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"plant": lambda rng: laboratory_arm()}, "plant cannot be a function.*mode='sync'"),
        ({"hardware": fa.Hardware()}, "ReachVectorEnv: hardware is not supported.*mode='sync'"),
        ({"changes": [fa.Change("payload.mass", to=1.0)]}, "changes is not supported.*mode='sync'"),
        ({"changes": lambda rng: []}, "changes is not supported.*mode='sync'"),
        ({"num_envs": 0}, "num_envs must be"),
        ({"threads": 0}, "threads must be"),
        ({"autoreset_mode": "later"}, "autoreset_mode must be one of 'NextStep', 'SameStep'"),
        ({"duration": 0.0}, "duration must be at least sample_time"),
    ],
    ids=lambda value: ", ".join(value) if isinstance(value, dict) else None,
)
def test_wrong_arguments_are_rejected(arguments, message):
    with pytest.raises(fa.InputError, match=message):
        gymnasium.make_vec(REACH, **arguments)


def test_both_unsupported_arguments_are_reported_at_once():
    with pytest.raises(fa.InputError, match=r"(?s)plant cannot.*hardware is not"):
        gymnasium.make_vec(REACH, hardware=fa.Hardware(), plant=lambda rng: laboratory_arm())


def test_arms_with_joint_limits_bristles_and_contacts_need_the_mode_sync():
    limits = fa.JointLimits(lower=-0.5, upper=0.7, stiffness=100.0)
    spec = laboratory_arm().spec
    stopped = fa.Arm(
        links=spec.links, joints=[spec.joints[0].replace(limits=limits), spec.joints[1]]
    )
    with pytest.raises(fa.InputError, match=r"no joint limits.*mode='sync'"):
        gymnasium.make_vec(REACH, arm=stopped, torque_limit=5.0)
    friction = fa.Friction(coulomb=0.1, bristle_stiffness=100.0)
    bristled = spec.replace(joints=[spec.joints[0].replace(friction=friction), spec.joints[1]])
    with pytest.raises(fa.InputError, match=r"combined with bristles \(arm.joints\[0\]\).*'sync'"):
        gymnasium.make_vec(REACH, arm=fa.Arm(bristled), torque_limit=5.0)
    envs = gymnasium.make_vec(REACH, 2, "sync", arm=stopped, torque_limit=5.0)
    assert envs.reset(seed=0)[0].shape == (2, 14)
    assert isinstance(gymnasium.make_vec(FORCE, num_envs=2), gymnasium.vector.SyncVectorEnv)


def test_wrong_calls_are_rejected():
    envs = gymnasium.make_vec(REACH, num_envs=2)
    action = np.zeros((2, 2), np.float32)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"reset\(\) before step"):
        envs.step(action)
    with pytest.raises(gymnasium.error.ResetNeeded, match="all sub-environments first"):
        envs.reset(options={"reset_mask": np.array([True, False])})
    with pytest.raises(fa.InputError, match="seed must be one number, or 2 of them"):
        envs.reset(seed=[1])
    envs.reset(seed=0)
    with pytest.raises(fa.InputError, match="actions must be"):
        envs.step(action[0])
    with pytest.raises(fa.InputError, match=r"actions.*nan"):
        envs.step(action * np.nan)
    with pytest.raises(fa.InputError, match="an option must be one of 'start', 'goal'"):
        envs.reset(options={"aim": 1})
    with pytest.raises(fa.InputError, match=r"reset_mask.*at least one of them True"):
        envs.reset(options={"reset_mask": np.zeros(2, bool)})
    with pytest.warns(UserWarning, match="rgb_array"):
        assert envs.render() is None
