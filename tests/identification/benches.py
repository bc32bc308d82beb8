"""The benches of ``tests/data/bench_records.py`` as arms, and their records with noise."""

from pathlib import Path

import numpy as np

import flexarm as fa
from data.bench_records import GAUGE, ONE, TWO, Bench

DATA = Path(__file__).resolve().parents[1] / "data"
#: Standard deviation of the noise of each channel: an encoder, a strain bridge, a camera.
NOISE = {"joint_angle": 2e-4, "strain": 5e-7, "tip": 5e-4}


def arm_of(bench: Bench, elements: int = 2) -> fa.Arm:
    """Return the arm of a bench with its true values."""
    links = [
        fa.Link(
            length=length,
            flexural_rigidity=bench.rigidity[k],
            mass_per_length=bench.mass_per_length[k],
            elements=elements,
            damping=fa.RayleighDamping(stiffness_coefficient=bench.damping[k]),
            gauges=[fa.Gauge(station=bench.station[k], distance=GAUGE)],
        )
        for k, length in enumerate(bench.lengths)
    ]
    joints = [
        fa.Joint(
            hub_inertia=bench.hub_inertia[k],
            damping=bench.joint_damping[k],
            mass=bench.joint_mass[k],
        )
        for k in range(len(bench.lengths))
    ]
    payload = fa.Payload(mass=bench.payload)
    return fa.Arm(links=links, joints=joints, payload=payload, theory="second_order")


#: Free parameters of each bench; all can be determined.
FREE = {
    ONE.name: [
        *("links[0].flexural_rigidity", "links[0].gauges[0].distance"),
        *("links[0].damping.stiffness_coefficient", "joints[0].damping"),
        *("joints[0].hub_inertia", "payload.mass"),
    ],
    TWO.name: [
        *("links[0].flexural_rigidity", "links[1].flexural_rigidity"),
        *("links[0].gauges[0].distance", "links[1].gauges[0].distance"),
        *("joints[0].damping", "joints[1].damping", "joints[1].mass"),
        *("joints[0].hub_inertia", "joints[1].hub_inertia", "payload.mass"),
    ],
}


def believed(bench: Bench, seed: int = 0, elements: int = 3) -> fa.Arm:
    """Return the arm with wrong values of its free parameters: up to 20 % from the true ones."""
    from flexarm.model.paths import number_at, with_number

    spec = arm_of(bench, elements).spec
    random = np.random.default_rng(seed)
    for path in FREE[bench.name]:
        factor = 1.0 + random.uniform(-0.2, 0.2)
        spec = with_number(spec, path, factor * number_at("path", spec, path))
    return fa.Arm(spec)


def truth(bench: Bench, path: str) -> float:
    """Return the true value of a parameter."""
    from flexarm.model.paths import number_at

    return number_at("path", arm_of(bench).spec, path)


def record(name: str, seed: int, outputs: tuple[str, ...] = ("joint_angle", "strain"), **settings):
    """Return a record with noise."""
    settings = {"interpolation": "hold", **settings}
    found = fa.read_record(DATA / f"{name}.csv", outputs=outputs, **settings)
    random = np.random.default_rng(seed)
    data = found.data.copy()
    for channel in outputs:
        noise = NOISE[channel] * random.standard_normal(data[channel].shape)
        data[channel] = data[channel] + noise
    return fa.MeasuredRecord(data, found.settings)
