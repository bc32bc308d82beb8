"""Train an agent that moves the tip of a flexible arm to random goals and stops it there.

The agent is a linear policy of 14 numbers on observations of `flexarm/Reach-v0`. CMA-ES improves
them in 45 generations of 16 policies, each with 8 random goals; the 128 arms of a generation are
simulated together in a vector environment. Needs `pip install "flexarm[learn]"`.

Prints: mean reward of a step: 0.23 without torque, 3 times as much with the agent
Usage: python train_agent.py [figure.png]
"""

import sys

import cma
import gymnasium
import matplotlib.pyplot as plt
import numpy as np

import flexarm.bridges.gymnasium_env  # noqa: F401  registers flexarm/Reach-v0

GENERATIONS, POLICIES, GOALS, FEATURES, JOINTS = 45, 16, 8, 7, 2
STEPS, SAMPLE_TIME = 200, 0.01
episode = {"sample_time": SAMPLE_TIME, "duration": STEPS * SAMPLE_TIME}


def features(observations):
    """Return the inputs (envs, 7) of the policy; the error of the tip is seen from link 1."""
    cos_1, cos_2, sin_1, sin_2 = observations[:, :4].T
    rates, strains = observations[:, 4:6], observations[:, 6:8]
    error_x, error_y = (observations[:, 12:14] - observations[:, 8:10]).T
    along = cos_1 * error_x + sin_1 * error_y
    across = cos_1 * error_y - sin_1 * error_x
    return np.column_stack([across, across * cos_2, along * sin_2, rates, strains])


def play(envs, policies, seeds):
    """Return the mean reward of each sub-environment in one episode, and which ones succeed."""
    observations, _ = envs.reset(seed=seeds)
    going, total = np.ones(envs.num_envs, bool), np.zeros(envs.num_envs)
    for _ in range(STEPS):
        actions = np.einsum("ef,efj->ej", features(observations), policies)
        observations, rewards, terminated, _, info = envs.step(actions)
        going &= ~terminated  # an episode that ends early gets no further rewards
        total += rewards * going
    return total / STEPS, info["is_success"] & going


search = cma.CMAEvolutionStrategy(
    np.zeros(FEATURES * JOINTS), 0.3, {"popsize": POLICIES, "seed": 1, "verbose": -9}
)
envs = gymnasium.make_vec("flexarm/Reach-v0", num_envs=POLICIES * GOALS, **episode)
progress = []
for generation in range(GENERATIONS):
    candidates = search.ask()
    policies = np.repeat(np.reshape(candidates, (POLICIES, FEATURES, JOINTS)), GOALS, axis=0)
    seeds = [GOALS * generation + goal for goal in range(GOALS)] * POLICIES
    rewards, _ = play(envs, policies, seeds)
    returns = rewards.reshape(POLICIES, GOALS).mean(axis=1)
    search.tell(candidates, -returns)
    progress.append(returns)
envs.close()

trained = search.result.xfavorite.reshape(FEATURES, JOINTS)
envs = gymnasium.make_vec("flexarm/Reach-v0", num_envs=100, **episode)
new_goals = [10_000 + k for k in range(100)]
untrained, _ = play(envs, np.zeros((100, FEATURES, JOINTS)), new_goals)
rewards, succeeds = play(envs, np.tile(trained, (100, 1, 1)), new_goals)
envs.close()
ratio = rewards.mean() / untrained.mean()
print(
    f"mean reward of a step: {untrained.mean():.2f} without torque, "
    f"{ratio:.0f} times as much with the agent"
)

if len(sys.argv) > 1:
    figure, axes = plt.subplots(layout="constrained")
    axes.plot(np.mean(progress, axis=1), label="mean of the policies")
    axes.plot(np.max(progress, axis=1), label="best policy")
    axes.set(xlabel="generation", ylabel="mean reward of a step, of at most 1")
    axes.set_title(f"The agent succeeds in {succeeds.sum()} of 100 episodes with new goals")
    axes.legend()
    figure.savefig(sys.argv[1])
