"""A clamped beam of one mode: a linear vibration with closed forms, for tests of integrators."""

from __future__ import annotations

from typing import Any

import numpy as np

import flexarm as fa


def clamped_beam(damping: float = 0.0) -> tuple[fa.Arm, float]:
    """Return the arm, with a ratio of modal damping, and its frequency (rad/s)."""
    link = fa.Link(
        length=1.0,
        flexural_rigidity=2.0,
        mass_per_length=0.5,
        elements=1,
        modes=1,
        damping=fa.ModalDamping(ratio=damping),
    )
    arm = fa.Arm(links=[link], joints=[fa.Joint(fixed=True)])
    return arm, float(np.sqrt(arm.assembly.constants.w2.max()))


def vibrate(arm: fa.Arm, integrator: Any, step: float, count: int) -> np.ndarray:
    """Return the mode and h times its rate after each step, (count + 1, 2), from 1e-3 and 2e-4."""
    result = fa.simulate(
        arm,
        count * step,
        initial=[1e-3],
        initial_rate=[2e-4 / step],
        integrator=integrator,
        rate=1.0 / step,
    )
    return np.stack([result.q.values[:, 0], step * result.qd.values[:, 0]], axis=1)
