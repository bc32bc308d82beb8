"""A link with friction under a given torque, for tests of estimators."""

import numpy as np

import flexarm as fa
from arms import observed_link

ENCODER = fa.Instrument("joint_angle", noise=2e-4)
STRAIN = fa.Instrument("strain", noise=3e-6)
FRICTION = "joints[0].friction.coulomb"


def one_link(coulomb=0.4):
    """Return a link with friction, whose smoothing extends over the rates of its motion."""
    return observed_link(friction=fa.Friction(coulomb=coulomb, smoothing_rate=0.5))


def record(
    plant, seed, noise=0.0, disturbance=0.0, duration=0.2, instruments=(ENCODER, STRAIN), **initial
):
    """Return the run of a plant in free motion under torques, the torques, and the readings."""
    random = np.random.default_rng([seed, 1])

    class Driven(fa.Controller):
        sample_time = 2e-3

        def reset(self):
            self.requested = []

        def update(self, t, measurement, reference):
            torque = np.array([3.0 * np.cos(30.0 * t)])
            self.requested.append(torque)
            return torque + disturbance + noise * random.standard_normal(1)

    controller = Driven()
    hardware = fa.Hardware(list(instruments), seed=seed)
    run = fa.simulate(
        plant,
        duration,
        rate=500.0,
        controller=controller,
        hardware=hardware,
        rtol=1e-9,
        atol=1e-11,
        **initial,
    )
    names = [item.label for item in instruments]
    return run, np.array(controller.requested), {n: run[f"measured_{n}"].values for n in names}
