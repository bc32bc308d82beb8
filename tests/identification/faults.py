"""Records of the benches with a fault that commissioning must name."""

import numpy as np

import flexarm as fa
from data import bench_records, geared_bench
from data.bench_records import ONE, RATE, TWO, Bench
from flexarm.model.paths import with_number
from identification import chains
from identification.benches import believed, record, rough_record, truth

#: Fault and words of which one names it.
FAULTS = {
    "friction": ("Coulomb friction",),
    "friction by direction": ("N m at positive and",),
    "Stribeck friction": ("Coulomb friction",),
    "backlash": ("backlash of joint 1", "Joint 1 has backlash"),
    "torque offset": ("torque_1 reads", "offset of torque_1"),
    "strain offset": ("strain_1 reads", "offset of strain_1"),
    "delay": ("strain_1 is late", "delay of strain_1"),
    "gain": ("distance of gauge 1", "gain of strain_1"),
    "dead sensor": ("strain_1 does not change",),
    "late sensor": ("strain_1 reads zero until",),
    "saturated": ("strain_1 is saturated",),
    "spikes": ("strain_1 has",),
    "lost samples": ("strain_1 lacks",),
    "wrapped encoder": ("joint_angle_1 jumps by a whole turn",),
    "torque delay": ("The torque acts about", "action of the torque before its record"),
    "torque gain": ("torque_1 reads", "gain of torque_1", "gain of the torque acts"),
    "encoder offset": ("joint_angle_2 reads", "offset of joint_angle_2"),
}
#: Faults that a bench does not have: the angle of the first joint has no effect without gravity,
#: and chains have one link.
UNSEEN = {
    ONE.name: ("encoder offset",),
    TWO.name: ("Stribeck friction",),
    geared_bench.THREE.name: ("encoder offset", "Stribeck friction"),
}


def faulty_record(fault: str, seed: int, end: float, bench: Bench = ONE) -> fa.MeasuredRecord:
    """Return a record with noise and a fault whose size depends on the seed; "" has no fault."""
    random = np.random.default_rng(2000 + seed)
    size = random.uniform(1.0, 2.0)
    if fault == "friction":
        return rough_record(bench, seed, end=end)
    clean = record(bench.name, seed, end=end)
    data = clean.data.copy(deep=True)
    strain = data["strain"].values[:, 0]
    torque = data["torque"].values
    places = random.choice(strain.size, round(5 * size), replace=False)
    if fault == "friction by direction":  # the torques of the record include that of friction
        rate = np.gradient(data["joint_angle"].values, 1.0 / clean.rate, axis=0)
        middle = 0.5 * (rate + np.roll(rate, -1, axis=0))
        sign = np.tanh(middle / (0.02 * np.abs(rate).max(axis=0)))
        torque += 0.03 * size * (sign + 0.5) * np.array(bench.amplitude)
    elif fault == "Stribeck friction":
        level = 8e-3 * size
        change = chains.change_of(bench, torque[:, 0], coulomb=(level, level), static=level)
    elif fault == "backlash":
        if bench is ONE:
            change = chains.change_of(bench, torque[:, 0], backlash=3e-3 * size)
        else:
            program = geared_bench if bench is geared_bench.THREE else bench_records
            change = program.change_by_backlash(bench, strain.size, 3e-3 * size)
    elif fault == "torque offset":
        torque[:, 0] += 0.02 * size * bench.amplitude[0]
    elif fault == "torque gain":
        torque *= 1.0 + 0.1 * size
    elif fault == "torque delay":  # the arm moves before the record shows its torque
        late = round(size)
        torque[late:] = torque[:-late].copy()
        torque[:late] = 0.0
    elif fault == "strain offset":
        strain += 0.1 * size * strain.std()
    elif fault == "delay":
        late = round(size)
        strain[late:] = strain[:-late].copy()
    elif fault == "gain":
        strain *= 1.0 + 0.15 * size
    elif fault == "dead sensor":
        strain[:] = 0.0
    elif fault == "late sensor":
        strain[: round(0.3 * size * RATE)] = 0.0
    elif fault == "saturated":
        np.clip(strain, *(0.6 / size * np.array([strain.min(), strain.max()])), out=strain)
    elif fault == "spikes":
        strain[places] += 20.0 * size * strain.std()
    elif fault == "lost samples":
        strain[places] = np.nan
    elif fault == "wrapped encoder":
        angle = data["joint_angle"].values
        middle = 0.5 * (angle[:, 0].min() + angle[:, 0].max())
        angle[:, 0] = (angle[:, 0] - middle) % (2.0 * np.pi)
    elif fault == "encoder offset":
        data["joint_angle"].values[:, 1] += 0.05 * size
    if fault in ("backlash", "Stribeck friction"):
        joints = torque.shape[1]
        data["joint_angle"].values[:] += change[:, :joints]
        data["strain"].values[:] += change[:, joints : 2 * joints]
    return fa.MeasuredRecord(data, clean.settings)


def data_sheet(fault: str, seed: int, bench: Bench = ONE) -> fa.Arm:
    """Return an arm wrong by up to 20 %, whose gauge does not hide an error of the gain."""
    arm = believed(bench, seed)
    if fault != "gain":
        return arm
    distance = "links[0].gauges[0].distance"
    return fa.Arm(with_number(arm.spec, distance, truth(bench, distance)))


def names_fault(result: fa.Identification, fault: str) -> bool:
    """Return whether a sentence of a result names a fault."""
    sentences = [*result.findings, *result.missing]
    if fault == "torque gain":  # masses that are all larger act in the same way
        sentences += result.undetermined
    return any(words in text for words in FAULTS[fault] for text in sentences)


def false_findings(result: fa.Identification, fault: str) -> list[str]:
    """Return sentences on other faults; the distances of gauges of the data sheet are wrong."""
    words = (*FAULTS.get(fault, ()), "distance of gauge")
    sentences = [*result.findings, *result.missing]
    return [text for text in sentences if not any(word in text for word in words)]
