"""The benches of ``tests/data`` as arms, and their records with noise."""

import warnings
from pathlib import Path

import numpy as np

import flexarm as fa
from data.bench_records import GAUGE, ONE, TWO, Bench
from data.geared_bench import START, THREE, GearedBench

DATA = Path(__file__).resolve().parents[1] / "data"
#: Standard deviation of the noise of each channel: an encoder, a strain bridge, a camera.
NOISE = {"joint_angle": 2e-4, "strain": 5e-7, "tip": 5e-4}
#: Elements of each link.
MESH = {ONE.name: (3,), TWO.name: (3, 2), THREE.name: (3,)}


def arm_of(bench: Bench, elements: int | tuple[int, ...] = 2) -> fa.Arm:
    """Return the arm of a bench with its true values; ``elements`` of all links or of each."""
    counts = np.broadcast_to(elements, len(bench.lengths)).tolist()
    links = [
        fa.Link(
            length=length,
            flexural_rigidity=bench.rigidity[k],
            mass_per_length=bench.mass_per_length[k],
            elements=counts[k],
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
            **(_drive(bench) if isinstance(bench, GearedBench) else {}),
        )
        for k in range(len(bench.lengths))
    ]
    payload = fa.Payload(mass=bench.payload)
    gravity = (0.0, -bench.gravity) if isinstance(bench, GearedBench) else (0.0, 0.0)
    return fa.Arm(
        links=links, joints=joints, payload=payload, theory="second_order", gravity=gravity
    )


def _drive(bench: GearedBench) -> dict:
    """Return the parameters of an elastic joint with friction."""
    friction = fa.Friction(
        coulomb=bench.coulomb,
        coulomb_negative=bench.coulomb_negative,
        viscous=bench.viscous,
        smoothing_rate=bench.smoothing_rate,
    )
    return {
        "stiffness": bench.gear_stiffness,
        "rotor_inertia": bench.rotor_inertia,
        "gear_ratio": bench.gear_ratio,
        "friction": friction,
    }


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
    THREE.name: [
        *("links[0].flexural_rigidity", "links[0].gauges[0].distance"),
        *("links[0].damping.stiffness_coefficient", "joints[0].stiffness", "joints[0].damping"),
        *("joints[0].rotor_inertia", "joints[0].friction.viscous", "payload.mass"),
        *("joints[0].friction.coulomb", "joints[0].friction.coulomb_negative"),
    ],
}

#: Options of the runs of a bench: the drive vibrates against the root of its link so fast that the
#: explicit method takes ten times as many evaluations.
OPTIONS = {THREE.name: {"integrator": "kennedy_carpenter_5"}}
#: Parameters of joint 1 that no record of the bench determines: of two, only a sum or a product
#: acts, and a joint that does not move has a mass without effect.
UNCLEAR = {
    ONE.name: ("hub_inertia", "rotor_inertia", "mass"),
    TWO.name: ("hub_inertia", "rotor_inertia", "mass"),
    THREE.name: ("rotor_inertia", "gear_ratio", "mass"),
}


def names_unclear(arm: fa.Arm, bench: Bench, measured: fa.MeasuredRecord) -> bool:
    """Return whether a fit that also frees the parameters of ``UNCLEAR`` reports them.

    The fit starts at ``arm``. It must name the pair together, the mass alone, and nothing else.
    """
    names = UNCLEAR[bench.name]
    free = dict.fromkeys([*FREE[bench.name], *(f"joints[0].{name}" for name in names)])
    first, *others = arm.spec.joints
    first = first.replace(rotor_inertia=first.rotor_inertia or 0.002, mass=0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", fa.IdentifiabilityWarning)
        found = fa.identify(
            fa.Arm(arm.spec.replace(joints=[first, *others])),
            measured,
            list(free),
            progress=False,
            **OPTIONS.get(bench.name, {}),
        )
    if len(found.undetermined) != 2:
        return False
    one, two, alone = (f"{name.replace('_', ' ')} of joint 1" for name in names)
    mass, pair = sorted(found.undetermined, key=len)
    return one in pair and two in pair and mass.startswith(f"The data do not determine the {alone}")


def believed(bench: Bench, seed: int = 0, elements: int | None = None) -> fa.Arm:
    """Return the arm with wrong values of its free parameters: up to 20 % from the true ones.

    ``elements`` of all links; by default those of ``MESH``.
    """
    from flexarm.model.paths import number_at, with_number

    spec = arm_of(bench, elements or MESH[bench.name]).spec
    random = np.random.default_rng(seed)
    for path in FREE[bench.name]:
        factor = 1.0 + random.uniform(-0.2, 0.2)
        spec = with_number(spec, path, factor * number_at("path", spec, path))
    return fa.Arm(spec)


def truth(bench: Bench, path: str) -> float:
    """Return the true value of a parameter."""
    from flexarm.model.paths import number_at

    return number_at("path", arm_of(bench).spec, path)


def record(
    name: str, seed: int | None, outputs: tuple[str, ...] = ("joint_angle", "strain"), **settings
) -> fa.MeasuredRecord:
    """Return a record with the noise of a seed; None: without noise."""
    own = {"interpolation": "hold"}
    if name == THREE.name:
        own = {"interpolation": "cubic", "initial_angle": [START]}
    settings = {**own, **settings}
    found = fa.read_record(DATA / f"{name}.csv", outputs=outputs, **settings)
    if seed is None:
        return found
    random = np.random.default_rng(seed)
    data = found.data.copy()
    for channel in outputs:
        noise = NOISE[channel] * random.standard_normal(data[channel].shape)
        data[channel] = data[channel] + noise
    return fa.MeasuredRecord(data, found.settings)


def rough_record(bench: Bench, seed: int, **settings) -> fa.MeasuredRecord:
    """Return a record with errors that the model of ``arm_of`` does not have.

    The joints have Coulomb friction of 2 to 8 % of the torques: the motors give the torques that
    move the arm of the record, and those of the friction in addition. The errors of the readings
    are correlated over 20 to 100 ms, and three times as large as ``NOISE``.
    """
    from scipy.signal import lfilter

    clean = record(bench.name, None, **settings)
    random = np.random.default_rng(1000 + seed)
    data = clean.data.copy(deep=True)
    rate = np.gradient(data["joint_angle"].values, 1.0 / clean.rate, axis=0)
    coulomb = random.uniform(0.02, 0.08) * np.array(bench.amplitude)
    middle = 0.5 * (rate + np.roll(rate, -1, axis=0))  # of the sample in which the torque is held
    slow = 0.02 * np.abs(rate).max(axis=0)
    data["torque"] = data["torque"] + coulomb * np.tanh(middle / slow)
    memory = np.exp(-1.0 / (clean.rate * random.uniform(0.02, 0.1)))
    for label in clean.settings.outputs:
        white = random.standard_normal((200 + clean.times.size, data[label].shape[1]))
        noise = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], white, axis=0)[200:]
        data[label] = data[label] + 3.0 * NOISE[label] * noise
    return fa.MeasuredRecord(data, clean.settings)
