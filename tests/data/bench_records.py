"""Records of two benches, simulated by MuJoCo: ``python tests/data/bench_records.py``.

The links are chains of rigid bars on torsional springs with dampers; the records are the limit of
many bars (Richardson) and contain no noise, which the tests add. The torques are multisines that
are constant between the samples. It needs the extra ``peers``; with ``--example`` it only makes
the records of ``examples/bench`` from those that exist.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

FOLDER = Path(__file__).resolve().parent
#: Samples per second, Hz.
RATE = 200


@dataclass(frozen=True)
class Bench:
    """A planar arm in a horizontal plane, straight and at rest at first; SI units.

    Attributes, for each link: flexural rigidity, mass per length, stiffness coefficient of the
    damping, hub inertia and viscous damping of the joint, mass of the joint's motor (at the tip of
    the link before), place of a strain gauge; for each joint, the amplitude of its torque.
    """

    name: str
    duration: float
    lengths: tuple[float, ...]
    rigidity: tuple[float, ...]
    mass_per_length: tuple[float, ...]
    damping: tuple[float, ...]
    hub_inertia: tuple[float, ...]
    joint_damping: tuple[float, ...]
    joint_mass: tuple[float, ...]
    station: tuple[float, ...]
    payload: float
    amplitude: tuple[float, ...]
    seed: int


ONE = Bench(
    name="bench_one_link",
    duration=6.0,
    lengths=(0.8,),
    rigidity=(8.0,),
    mass_per_length=(0.35,),
    damping=(8e-4,),
    hub_inertia=(0.02,),
    joint_damping=(0.05,),
    joint_mass=(0.0,),
    station=(0.06,),
    payload=0.15,
    amplitude=(0.3,),
    seed=1,
)
TWO = Bench(
    name="bench_two_links",
    duration=6.0,
    lengths=(0.7, 0.5),
    rigidity=(22.0, 6.0),
    mass_per_length=(0.55, 0.3),
    damping=(2e-4, 2e-4),
    hub_inertia=(0.03, 0.008),
    joint_damping=(0.08, 0.03),
    joint_mass=(0.0, 0.4),
    station=(0.05, 0.05),
    payload=0.1,
    amplitude=(0.8, 0.2),
    seed=2,
)
#: The same arms under other torques.
OTHERS = {
    "bench_one_link_other": (ONE, 3.0, 11),
    "bench_two_links_other": (TWO, 3.0, 12),
}
#: Distance of the gauges from the neutral axis (m).
GAUGE = 1e-3
#: Bars of a link in the coarse chain, and steps per sample; for a change by backlash.
_BARS, _STEPS, _FAST = 8, 500, 200
#: Part of the inertia of a hub that is that of the motor, before a gear with backlash.
_MOTOR = 0.4


def torques(bench: Bench, duration: float, seed: int) -> np.ndarray:
    """Return multisines of 0.25 to 12 Hz (samples, joints), N m, which start smoothly."""
    random = np.random.default_rng(seed)
    times = np.arange(round(duration * RATE) + 1) / RATE
    frequencies = np.arange(1, 49) * 0.25
    rows = []
    for amplitude in bench.amplitude:
        phases = random.uniform(0.0, 2.0 * np.pi, frequencies.size)
        waves = np.sin(2.0 * np.pi * frequencies[:, None] * times + phases[:, None])
        wave = (waves / np.sqrt(1.0 + frequencies[:, None])).sum(axis=0)
        rows.append(amplitude * wave / np.abs(wave).max() * np.minimum(1.0, times / 0.25))
    return np.stack(rows, axis=1)


def simulate(
    bench: Bench,
    torque: np.ndarray,
    count: int,
    backlash: float | None = None,
    steps: int = _STEPS,
) -> np.ndarray:
    """Return joint angles, strains and the tip (samples, joints + gauges + 2).

    With ``backlash`` (rad) a stiff gear with this gap is between the motor of the first joint,
    which has a part of the inertia of the hub, and the link. The joint angle is that of the motor.
    """
    import mujoco
    from mujoco import rollout

    step = 1.0 / (RATE * steps)
    root = _description(bench, count, step)
    if backlash is not None:
        _add_gear(root, backlash, _MOTOR * bench.hub_inertia[0])
    model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    start = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, start, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    held = np.repeat(torque, steps, axis=0)[: (len(torque) - 1) * steps + 1]
    _, sensed = rollout.rollout(model, data, start[None], held[None])
    if data.warning.number.any():
        raise RuntimeError("MuJoCo became unstable: the step is too long.")
    rows = sensed[0, ::steps]
    joints = len(bench.lengths)
    columns = [rows[:, :joints]]
    for link in range(joints):
        piece = bench.lengths[link] / count
        first = joints + link * count
        curvature = rows[:, first : first + count] / piece
        centres = (np.arange(count) + 0.5) * piece
        columns.append(-GAUGE * interpolated(centres, curvature, bench.station[link])[:, None])
    return np.concatenate([*columns, rows[:, -3:-1]], axis=1)


def interpolated(places: np.ndarray, values: np.ndarray, place: float) -> np.ndarray:
    """Interpolate (samples, places) by a polynomial through the four nearest places."""
    near = np.argsort(np.abs(places - place))[:4]
    weights = [
        np.prod([(place - places[j]) / (places[k] - places[j]) for j in near if j != k])
        for k in near
    ]
    return values[:, near] @ np.array(weights)


def change_by_backlash(bench: Bench, samples: int, backlash: float) -> np.ndarray:
    """Return the change of the columns of a record by backlash (rad) of the first joint."""
    torque = torques(bench, bench.duration, bench.seed)[:samples]
    with_gap, without = (simulate(bench, torque, _BARS, gap, _FAST) for gap in (backlash, 1e-7))
    return with_gap - without


def _description(bench: Bench, count: int, step: float) -> Element:
    """Describe the chain in MuJoCo's format; sensors: joints, springs, tip."""
    root = Element("mujoco")
    SubElement(root, "compiler", angle="radian")
    option = SubElement(root, "option", timestep=repr(step), integrator="RK4", gravity="0 0 0")
    SubElement(option, "flag", contact="disable")
    body = SubElement(root, "worldbody")
    actuators, sensors = Element("actuator"), Element("sensor")
    springs, offset = [], 0.0
    for link, length in enumerate(bench.lengths):
        piece = length / count
        stiffness = bench.rigidity[link] / piece
        if bench.joint_mass[link]:
            _add_mass(body, offset, bench.joint_mass[link])
        for k in range(count + 1):
            own = piece if 0 < k < count else piece / 2
            body = SubElement(body, "body", pos=f"{offset!r} 0 0")
            joint = SubElement(body, "joint", type="hinge", axis="0 0 1")
            joint.set("name", f"motor{link}" if k == 0 else f"spring{link}_{k}")
            joint.set("stiffness", repr(0.0 if k == 0 else stiffness))
            inner = bench.damping[link] * stiffness
            joint.set("damping", repr(bench.joint_damping[link] if k == 0 else inner))
            if k == 0:
                SubElement(actuators, "motor", joint=f"motor{link}")
                SubElement(sensors, "jointpos", joint=f"motor{link}")
            else:
                springs.append(f"spring{link}_{k}")
            mass = bench.mass_per_length[link] * own
            inertia = mass * own**2 / 12 + (bench.hub_inertia[link] if k == 0 else 0.0)
            around = " ".join([repr(inertia)] * 3)
            place = f"{own / 2!r} 0 0"
            SubElement(body, "inertial", pos=place, mass=repr(mass), diaginertia=around)
            offset = own
    _add_mass(body, offset, bench.payload)
    SubElement(body, "site", name="tip", pos=f"{offset!r} 0 0")
    for name in springs:
        SubElement(sensors, "jointpos", joint=name)
    SubElement(sensors, "framepos", objtype="site", objname="tip")
    root.extend([actuators, sensors])
    return root


def _add_gear(root: Element, backlash: float, inertia: float) -> None:
    """Put a motor and the limits of a gear before the first link."""
    world = root.find("worldbody")
    link = world.find("body")
    joint, hub = link.find("joint"), link.find("inertial")
    for part in (link, joint):
        (world if part is link else link).remove(part)
    motor = SubElement(world, "body", pos="0 0 0")
    around = " ".join([repr(inertia)] * 3)
    SubElement(motor, "inertial", pos="0 0 0", mass="1e-9", diaginertia=around)
    left = float(hub.get("diaginertia").split()[0]) - inertia
    hub.set("diaginertia", " ".join([repr(left)] * 3))
    gear = Element("joint", type="hinge", axis="0 0 1", name="gear", limited="true")
    gear.set("range", f"{-0.5 * backlash!r} {0.5 * backlash!r}")
    gear.set("solreflimit", "0.0005 1")  # time constant (s) and damping ratio of its contacts
    gear.set("solimplimit", "0.95 0.99 0.0001")
    link.insert(0, gear)
    motor.extend([joint, link])


def _add_mass(body: Element, place: float, mass: float) -> None:
    """Fix a point mass to a body; MuJoCo requires a little inertia."""
    own = SubElement(body, "body", pos=f"{place!r} 0 0")
    SubElement(own, "inertial", pos="0 0 0", mass=repr(mass), diaginertia="1e-9 1e-9 1e-9")


def write(name: str, bench: Bench, duration: float, seed: int) -> None:
    """Write a record as CSV."""
    torque = torques(bench, duration, seed)
    coarse, fine = (simulate(bench, torque, count) for count in (_BARS, 2 * _BARS))
    limit = fine + (fine - coarse) / 3.0
    print(name, "largest correction of the chain:", np.abs(limit - fine).max(axis=0))
    numbers = range(1, len(bench.lengths) + 1)
    heads = ["time [s]", *(f"torque_{k} [N m]" for k in numbers)]
    heads += [f"joint_angle_{k} [rad]" for k in numbers]
    heads += [*(f"strain_{k} [1]" for k in numbers), "tip_x [m]", "tip_y [m]"]
    times = np.arange(len(torque)) / RATE
    table = np.column_stack([times, torque, limit])
    path = FOLDER / f"{name}.csv"
    np.savetxt(path, table, fmt="%.8g", delimiter=",", header=",".join(heads), comments="")


def write_example(source: str, file: str, seed: int) -> None:
    """Write a record as a bench would: encoder counts, strain in um/m with noise, a delay."""
    table = np.genfromtxt(FOLDER / f"{source}.csv", delimiter=",", names=True)[: 3 * RATE + 1]
    time, torque, angle, strain = (table[name] for name in table.dtype.names[:4])
    random = np.random.default_rng(seed)
    turns = np.round((angle + 1e-4 * random.standard_normal(angle.size)) / COUNT) * COUNT
    late = np.concatenate([strain[:1], strain[:-1]])  # the bridge amplifier: one sample
    micro = 1e6 * late + 3.0 + 0.5 * random.standard_normal(late.size)  # and an offset
    columns = np.column_stack([time, torque, np.rad2deg(turns), micro])
    head = "t [s],motor [N m],encoder [deg],bridge [um/m]"
    path = FOLDER.parents[1] / "examples" / "bench" / file
    np.savetxt(
        path, columns, fmt=("%.4f", "%.6g", "%.5f", "%.2f"), delimiter=",", header=head, comments=""
    )


#: Angle of one count of the encoder (rad), and records of the example: source, file, seed.
COUNT = 2.0 * np.pi / 40_000
EXAMPLES = (("bench_one_link", "multisine.csv", 1), ("bench_one_link_other", "check.csv", 2))


if __name__ == "__main__":
    if "--example" not in sys.argv:
        for one in (ONE, TWO):
            write(one.name, one, one.duration, one.seed)
        for file, (like, seconds, number) in OTHERS.items():
            write(file, like, seconds, number)
    for example in EXAMPLES:
        write_example(*example)
