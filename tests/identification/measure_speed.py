"""CPU time of fits beside SciPy's least squares: ``python tests/identification/measure_speed.py``.

SciPy changes the same parameters of the same arm until the runs of ``fa.simulate``, with default
arguments, fit the record; it knows the noise, and that the arm starts at rest. ``fa.identify``
estimates both, and looks for missing effects and other arms that fit as well.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import flexarm as fa
from data.bench_records import ONE, TWO, Bench
from flexarm.model.paths import number_at, with_number
from identification.benches import FREE, NOISE, believed, record, truth


def by_scipy(arm: fa.Arm, measured: fa.MeasuredRecord, free: list[str]) -> np.ndarray:
    """Return the estimates of SciPy's least squares around ``simulate``."""
    start = np.array([number_at("path", arm.spec, path) for path in free])
    common = {"torque": measured.data["torque"].values, "torque_interpolation": "hold"}
    duration = float(measured.times[-1] - measured.times[0])

    def residuals(factors: np.ndarray) -> np.ndarray:
        spec = arm.spec
        for path, value in zip(free, (factors * start).tolist(), strict=True):
            spec = with_number(spec, path, value)
        run = fa.simulate(fa.Arm(spec), duration, rate=measured.rate, progress=False, **common)
        channels = ("joint_angle", "strain")
        errors = [(run[c].values - measured.data[c].values) / NOISE[c] for c in channels]
        return np.concatenate([error.ravel() for error in errors])

    return start * least_squares(residuals, np.ones(start.size)).x


def compare(bench: Bench, free: list[str], seed: int) -> None:
    """Print CPU seconds and largest relative errors of both."""
    arm, measured = believed(bench, seed), record(bench.name, seed, end=3.0)
    true = np.array([truth(bench, path) for path in free])
    spec = arm.spec
    for path in set(FREE[bench.name]) - set(free):
        spec = with_number(spec, path, truth(bench, path))
    arm = fa.Arm(spec)

    def fit(**options) -> np.ndarray:
        result = fa.identify(arm, measured, free, progress=False, **options)
        return result.parameters["estimate"].values

    ways = {
        "SciPy": lambda: by_scipy(arm, measured, free),
        "identify, one start": lambda: fit(starts=1),
        "identify": fit,
    }
    words = []
    for name, way in ways.items():
        started = time.process_time()
        error = np.abs(way() / true - 1.0).max()
        words.append(f"{name} {time.process_time() - started:.1f} s ({100.0 * error:.2g} %)")
    print(f"{bench.name}, {len(free)} parameters, seed {seed}: {', '.join(words)}", flush=True)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for seed in range(int(sys.argv[1]) if len(sys.argv) > 1 else 3):
        for bench in (ONE, TWO):
            for count in (3, len(FREE[bench.name])):
                compare(bench, FREE[bench.name][:count], seed)
