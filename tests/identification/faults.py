"""Records of the bench with one link and a fault that commissioning must name."""

import numpy as np

import flexarm as fa
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
    return fa.MeasuredRecord(data, clean.settings)


def names_fault(result: fa.Identification, fault: str) -> bool:
    """Return whether a sentence of a result names a fault."""
    sentences = [*result.findings, *result.missing]
    return any(words in text for words in FAULTS[fault] for text in sentences)
