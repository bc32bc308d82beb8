"""Samples between long steps are as accurate as those at the ends of steps."""

import numpy as np
import pytest

import flexarm as fa

#: In these steps, the fastest mode turns by 12 rad or more.
HOW = {
    "kennedy_carpenter_5": {"rtol": 1e-4},
    "gauss_6": {"step": 2e-3},
    "generalized_alpha": {"step": 2e-3},
}


@pytest.mark.parametrize("method", HOW)
def test_samples_between_steps(method):
    """The modes that the steps do not resolve follow the load, and count in rates and energies."""
    link = fa.Link(
        length=1.0, flexural_rigidity=20.0, mass_per_length=0.5, elements=4, modes=8,
        damping=fa.ModalDamping(ratio=0.02),
    )  # fmt: skip
    arm = fa.Arm(links=[link, link], joints=[fa.Joint(hub_inertia=0.05)] * 2)
    run = {"torque": lambda t: np.array([2.0, 1.0]), "rate": 97.0, "progress": False}
    ends = np.arange(1, 48) / 97.0
    exact = fa.simulate(arm, 0.5, rtol=1e-10, **run)

    def errors(**how):
        result = fa.simulate(arm, 0.5, integrator=method, **HOW[method], **how, **run)
        names = "tip", "tip_velocity", "kinetic_energy", "strain_energy"
        largest = (np.abs(exact[name]).max() for name in names)
        apart = (np.abs(result[name] - exact[name]).max() for name in names)
        return np.array([float(a / b) for a, b in zip(apart, largest, strict=True)])

    between, at_ends = errors(), errors(breaks=ends)
    # Ends at the samples also shorten the steps.
    assert np.all(between < 4.0 * at_ends), (between, at_ends)


def test_samples_after_a_vibration():
    """A long step loses the vibration at its start, and samples leave out what belongs to it."""
    length, mass = 0.8, 0.5
    link = fa.Link(
        length=length,
        flexural_rigidity=mass * (2.0 * np.pi * 584.0) ** 2 * length**4 / 3.516**2,
        mass_per_length=mass,
        damping=fa.ModalDamping(ratio=0.01),
    )
    arm = fa.Arm(links=[link], joints=[fa.Joint(hub_inertia=0.3 * mass * length**3)])
    # Steps that end at these times, like those at torque samples, leave some of the vibration.
    for breaks in ([0.506], [0.506, 0.508, 0.51, 0.512]):
        run = {"torque": lambda t: [0.7 if t < 0.506 else -0.7], "breaks": breaks}
        exact = fa.simulate(arm, 1.0, integrator="dormand_prince_8", rtol=1e-10, **run)
        result = fa.simulate(arm, 1.0, integrator="kennedy_carpenter_5", rtol=1e-4, **run)
        assert result.attrs["steps"] < 50  # up to 0.5 s: the period of the vibration is 1.7 ms
        errors = np.abs(result.tip - exact.tip).max("axis").values
        # m; with the acceleration 2e-2 and 6e-3, with the rate 5e-3 in the second run
        assert errors.max() < 3e-5
