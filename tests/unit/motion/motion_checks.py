"""Shared parts of motion tests: a stand-in for an arm, and derivatives by finite differences."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace

import numpy as np

from flexarm.model import Joint

# Published lengths of the two-link example arm, m (Table I: L1 = 1.4142, L2 = 1, rods of 0.61732
# kg/m), whose tip moves from (2, 1) to (1, 2).
TABLE_I_LENGTHS = (1.4142, 1.0)


@dataclass
class Links:
    """Properties of an arm that motions use: lengths, and the joints that turn."""

    link_lengths: tuple[float, ...] = TABLE_I_LENGTHS

    @property
    def lengths(self) -> np.ndarray:
        return np.array(self.link_lengths)

    @property
    def n_joints(self) -> int:
        return len(self.link_lengths)

    @property
    def n_links(self) -> int:
        return len(self.link_lengths)

    @property
    def assembly(self) -> SimpleNamespace:
        return SimpleNamespace(
            seats=[SimpleNamespace(link=i) for i in range(self.n_links)], base=()
        )

    @property
    def spec(self) -> SimpleNamespace:
        joints = [Joint()] * self.n_links
        return SimpleNamespace(joints=joints, is_serial=True, features=())

    @property
    def reach(self) -> float:
        return float(np.sum(self.lengths))


def derivative(function: Callable[[np.ndarray], np.ndarray], t: np.ndarray, step: float):
    """Return a central difference of sixth order; `t` must be 3 steps away from any break."""
    weights = {1: 3 / 4, 2: -3 / 20, 3: 1 / 60}
    terms = [w * (function(t + k * step) - function(t - k * step)) for k, w in weights.items()]
    return sum(terms) / step


def smooth_times(breaks: tuple[float, ...], away: float, count: int = 41) -> np.ndarray:
    """Return times between the breaks, at least `away` from each."""
    return np.concatenate([np.linspace(a + away, b - away, count) for a, b in pairwise(breaks)])


def assert_scalars_and_arrays_agree(motion, atol: float) -> None:
    """Compare values of single times with those of many times at once."""
    t = np.array([0.2, 0.9, 1.7, 3.5])
    together = motion.state(t)
    for row, time in enumerate(t):
        for many, one in zip(together, motion.state(time), strict=True):
            assert one.shape == (motion.joints,)
            np.testing.assert_allclose(many[row], one, rtol=0, atol=atol)
    assert motion.tip(t).shape == (4, 2)
    assert motion.tip(1.0).shape == (2,)
    for part, function in zip(
        together, [motion.joint_angle, motion.joint_rate, motion.joint_acceleration], strict=True
    ):
        np.testing.assert_array_equal(part, function(t))
