"""Consistency of the filters: errors against their own covariance, over seeds.

Three arms, at standstill and in motion. For each seed everything that the filter takes for
random is drawn as it assumes: the payload, the initial rates and vibrations, the torque noise, the
noise of the readings. If the covariance is right, the normalised estimation error squared is 1 per
state on average, and its mean over the runs within the band of the chi-squared distribution.

    python docs/performance/measure_consistency.py [seeds [filter]]
"""

from __future__ import annotations

import sys
import warnings

import numpy as np
from scipy.stats import chi2

import flexarm as fa

TORQUE_NOISE, RATE, ENERGY = 0.02, 0.1, 0.01  # N m, rad/s, J
DURATION, SAMPLE_TIME = 0.25, 1e-3  # s
JUDGED = (0.1, 0.24)  # s
INSTRUMENTS = [
    fa.Instrument("joint_angle", noise=1e-4),
    fa.Instrument("strain", noise=2e-6),
]


def link(length, rigidity, mass, **options):
    """Return a link with a strain gauge near its root."""
    return fa.Link(
        length=length,
        flexural_rigidity=rigidity,
        mass_per_length=mass,
        gauges=[fa.Gauge(station=0.02, distance=0.005)],
        damping=fa.ModalDamping(ratio=0.005),
        **options,
    )


def joints(*hub_inertias):
    """Return joints, all but the first with a mass."""
    first, *others = hub_inertias
    return [
        fa.Joint(hub_inertia=first),
        *(fa.Joint(mass=0.6, hub_inertia=inertia, housing_inertia=0.05) for inertia in others),
    ]


#: Arm, gains of the joint PD, start and end of the motion (rad). The payload's mass and the
#: deviation that it is drawn with are the same number.
ARMS = {
    "one link": (
        fa.Arm(
            links=[link(1.0, 40.0, 0.4, elements=4, modes=1)],
            joints=joints(0.05),
            payload=fa.Payload(mass=0.2),
        ),
        ([40.0], [4.0], [0.2], [1.0]),
    ),
    "two links": (
        fa.Arm(
            links=[link(0.9, 500.0, 0.7, elements=1), link(0.7, 350.0, 0.5, elements=1)],
            joints=joints(0.2, 0.05),
            payload=fa.Payload(mass=0.5),
        ),
        ([300.0, 80.0], [25.0, 6.0], [0.3, -0.8], [0.9, 0.2]),
    ),
    "two links, vertical": (
        fa.Arm(
            links=[link(length, 200.0, 0.5, elements=2, modes=1) for length in (0.8, 0.6)],
            joints=joints(0.1, 0.03),
            payload=fa.Payload(mass=0.2),
            gravity=(0.0, -9.81),
        ),
        ([200.0, 60.0], [18.0, 5.0], [0.3, -0.8], [0.9, 0.2]),
    ),
}


#: Filters by the names of the page.
FILTERS = {
    "extended": fa.ExtendedKalmanFilter,
    "unscented": fa.UnscentedKalmanFilter,
    "moving horizon": fa.MovingHorizonEstimator,
}


class Shaken(fa.Controller):
    """A joint PD whose torque acts with an error that it does not know."""

    sample_time = SAMPLE_TIME

    def __init__(self, inner, seed):
        self.inner, self.seed = inner, seed

    def reset(self):
        self.inner.reset()
        self.random, self.requested = np.random.default_rng([self.seed, 1]), []

    def update(self, t, measurement, reference):
        torque = np.asarray(self.inner.update(t, measurement, reference))
        self.requested.append(torque)
        return torque + TORQUE_NOISE * self.random.standard_normal(torque.size)


def errors(name, moving, seed, kind="extended"):
    """Return the normalised errors squared at the times JUDGED, and whether it passed its test."""
    arm, (proportional, derivative, start, end) = ARMS[name]
    random = np.random.default_rng([seed, 0])
    mean = arm.spec.payload.mass
    mass = mean * np.exp(np.sqrt(np.log(2.0)) * random.standard_normal() - 0.5 * np.log(2.0))
    plant = fa.varied(arm, payload_mass=mass)
    q, qd = fa.equilibrium(plant, start).q, np.zeros(arm.dof)
    elastic = np.setdiff1d(np.arange(arm.dof), arm.joint_index)
    stiffness = np.diag(arm.stiffness_matrix(arm.rest(start)))[elastic]
    q[elastic] += np.sqrt(2.0 * ENERGY / stiffness) * random.standard_normal(elastic.size)
    qd[elastic] = np.sqrt(2.0 * ENERGY) * random.standard_normal(elastic.size)
    qd[arm.joint_index] = RATE * random.standard_normal(arm.n_joints)
    controller = Shaken(fa.JointPD(proportional, derivative), seed)
    run = fa.simulate(
        arm,
        DURATION,
        controller=controller,
        reference=fa.joint_motion(arm, start, end if moving else start, DURATION),
        plant=plant,
        initial=q,
        initial_rate=qd,
        hardware=fa.Hardware([*INSTRUMENTS, fa.Instrument("joint_rate")], seed=seed),
        rate=1.0 / SAMPLE_TIME,
        rtol=1e-8,
        atol=1e-10,
    )
    readings = {item.label: run[f"measured_{item.label}"].values for item in INSTRUMENTS}
    estimator = FILTERS[kind](
        arm, INSTRUMENTS, TORQUE_NOISE, payload_deviation=mean, rate_deviation=RATE,
        energy_deviation=ENERGY,
    )  # fmt: skip
    found = estimator.run(np.array(controller.requested), readings)
    squared = []
    for tick in (round(t / SAMPLE_TIME) for t in JUDGED):
        truth = np.concatenate([run.q.values[tick], run.qd.values[tick], [mass]])
        estimate = np.concatenate([found.q[tick], found.qd[tick], [found.payload_mass[tick]]])
        error = estimate - truth
        squared.append(error @ np.linalg.solve(found.covariance[tick], error))
    return squared, found.consistent


def row(name, moving, seeds, kind="extended"):
    """Return a line of the table: means of the normalised errors squared per state, and band."""
    size = seeds * (2 * ARMS[name][0].dof + 1)
    low, high = chi2.ppf([0.025, 0.975], size) / size
    squared, consistent = zip(
        *(errors(name, moving, seed, kind) for seed in range(seeds)), strict=True
    )
    means = " | ".join(f"{mean:.3f}" for mean in np.sum(squared, axis=0) / size)
    state = "in motion" if moving else "at rest"
    alarms = seeds - sum(consistent)
    return f"| {name} | {state} | {means} | {low:.3f} to {high:.3f} | {alarms} |"


def main(seeds, kind="extended"):
    """Print the table of the page, for one of the ``FILTERS``."""
    warnings.simplefilter("ignore")
    heads = " | ".join(f"at {t} s" for t in JUDGED)
    print(f"| arm | joints | {heads} | 95 % band | inconsistent |")
    print("| --- " * (4 + len(JUDGED)) + "|")
    for name in ARMS:
        for moving in (False, True):
            print(row(name, moving, seeds, kind), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 100, *sys.argv[2:])
