"""Random arms, and true errors of their runs."""

import numpy as np

import flexarm as fa

QUIET = {"rate": 100.0, "progress": False}


def random_arm(seed, friction=False):
    """Return an arm of 1 to 3 links with first clamped frequencies of 2 to 20 Hz, and torques."""
    rng = np.random.default_rng(seed)
    links, sizes = [], []
    for _ in range(1 + seed % 3):
        length, mass, frequency = rng.uniform(0.5, 1.5), rng.uniform(0.2, 3.0), rng.uniform(12, 120)
        rigidity = frequency**2 * mass * length**3 / 3.516**2
        links.append(
            fa.Link(
                length=length,
                flexural_rigidity=rigidity,
                mass_per_length=mass / length,
                elements=4,
                modes=int(rng.integers(2, 9)),
                damping=fa.ModalDamping(ratio=0.02),
            )
        )
        sizes.append(0.03 * rigidity / length)
    rubs = fa.Friction(coulomb=0.2) if friction else None
    arm = fa.Arm(links=links, joints=[fa.Joint(hub_inertia=0.05, friction=rubs)] * len(links))
    size, rate = np.minimum(sizes, 5.0), rng.uniform(0.5, 2.0)
    return arm, lambda t: size * np.sin(2.0 * np.pi * rate * t)


def tip_error(arm, result, **arguments):
    exact = fa.simulate(arm, 0.6, rtol=1e-11, integrator="dormand_prince_8", **arguments, **QUIET)
    return float(np.abs(result.tip.values - exact.tip.values)[:, :2].max())
