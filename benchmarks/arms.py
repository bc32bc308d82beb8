"""Arms that the benchmarks share."""

from __future__ import annotations

import numpy as np

import flexarm as fa


def table_one(
    elements: tuple[int, int] = (2, 1), rigidity: float = 105.0, **options: object
) -> fa.Arm:
    """Return the two-link arm of the paper's Table I, or with another flexural rigidity."""
    lengths, mass = (1.4142, 1.0), 0.61732
    return fa.Arm(
        links=[
            fa.Link(length=length, flexural_rigidity=rigidity, mass_per_length=mass, elements=count)
            for length, count in zip(lengths, elements, strict=True)
        ],
        **options,
    )


def chain(links: int, modes: int = 4, elements: int = 4, theory: str = "linear") -> fa.Arm:
    """Return a chain of equal flexible links."""
    link = fa.Link(
        length=0.5,
        flexural_rigidity=20.0,
        mass_per_length=0.5,
        elements=elements,
        modes=modes,
    )
    return fa.Arm(links=[link] * links, theory=theory)


def moving_state(arm: fa.Arm) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a reproducible state (q, qd) in motion, and torques."""
    rng = np.random.default_rng(1)
    q, qd = 1e-4 * rng.normal(size=(2, arm.dof))
    q[arm.joint_index] = rng.uniform(-1.0, 1.0, arm.n_joints)
    qd[arm.joint_index] = rng.uniform(-1.0, 1.0, arm.n_joints)
    return q, qd, rng.uniform(-1.0, 1.0, arm.n_joints)
