"""Records of the bench with one link and a fault that commissioning must name."""

import copy
from functools import cache
from xml.etree import ElementTree

import numpy as np

import flexarm as fa
from data import bench_records
from data.bench_records import ONE, RATE
from identification.benches import record, rough_record

#: Fault and words of which one names it.
FAULTS = {
    "friction": ("Coulomb friction",),
    "torque offset": ("torque_1 reads", "offset of torque_1"),
    "strain offset": ("strain_1 reads", "offset of strain_1"),
    "delay": ("strain_1 is late", "delay of strain_1"),
    "gain": ("distance of gauge 1", "gain of strain_1"),
    "dead sensor": ("strain_1 does not change",),
    "late sensor": ("strain_1 reads zero until",),
    "backlash": ("backlash of joint 1",),
}


def faulty_record(fault: str, seed: int, end: float) -> fa.MeasuredRecord:
    """Return a record with noise and a fault whose size depends on the seed."""
    random = np.random.default_rng(2000 + seed)
    size = random.uniform(1.0, 2.0)
    if fault == "friction":
        return rough_record(ONE, seed, end=end)
    clean = record(ONE.name, seed, end=end)
    data = clean.data.copy(deep=True)
    strain = data["strain"].values
    if fault == "torque offset":
        data["torque"] = data["torque"] + 0.02 * size * ONE.amplitude[0]
    elif fault == "strain offset":
        data["strain"] = data["strain"] + 0.1 * size * strain.std()
    elif fault == "delay":
        late = round(size)
        data["strain"][late:] = strain[:-late]
    elif fault == "gain":
        data["strain"] = (1.0 + 0.15 * size) * data["strain"]
    elif fault == "dead sensor":
        data["strain"][:] = 0.0
    elif fault == "late sensor":
        data["strain"][: round(0.3 * size * RATE)] = 0.0
    elif fault == "backlash":
        angle, strain = with_backlash(np.deg2rad(0.5 * size), end)
        for name, values, noise in (("joint_angle", angle, 2e-4), ("strain", strain, 5e-7)):
            data[name][:, 0] = values + noise * random.standard_normal(values.size)
    return fa.MeasuredRecord(data, clean.settings)


@cache
def with_backlash(gap: float, end: float) -> tuple[np.ndarray, np.ndarray]:
    """Return motor angle and strain (samples,) by MuJoCo of a link behind a gap (rad)."""
    original = bench_records._description

    def description(bench, count, step):
        root = ElementTree.fromstring(original(bench, count, step))
        motor = root.find("worldbody/body")
        (joint,) = (item for item in motor.findall("joint") if item.get("name") == "motor0")
        link = copy.deepcopy(motor)
        link.remove(next(iter(link.findall("joint"))))
        half = str(0.5 * gap)
        limits = {"limited": "true", "range": f"-{half} {half}", "solreflimit": "0.0002 1"}
        gear = ElementTree.Element("joint", type="hinge", axis="0 0 1", name="gap", **limits)
        link.insert(0, gear)
        inertial = link.find("inertial")
        own = bench.mass_per_length[0] * (bench.lengths[0] / count / 2)
        around = own * (bench.lengths[0] / count / 2) ** 2 / 12
        inertial.set("diaginertia", " ".join([repr(around)] * 3))
        for item in list(motor):
            if item is not joint:
                motor.remove(item)
        hub = " ".join([repr(bench.hub_inertia[0])] * 3)
        ElementTree.SubElement(motor, "inertial", pos="0 0 0", mass="1e-6", diaginertia=hub)
        motor.append(link)
        return ElementTree.tostring(root, encoding="unicode")

    torque = bench_records.torques(ONE, ONE.duration, ONE.seed)[: round(end * RATE) + 1]
    bench_records._description = description
    try:
        rows = bench_records.simulate(ONE, torque, bench_records._BARS)
    finally:
        bench_records._description = original
    return rows[:, 0], rows[:, 1]


def names_fault(result: fa.Identification, fault: str) -> bool:
    """Return whether a sentence of a result names a fault."""
    sentences = [*result.findings, *result.missing]
    return any(words in text for words in FAULTS[fault] for text in sentences)
