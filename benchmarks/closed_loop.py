"""A flexible four-bar under gravity: error and time of flexarm and of Exudyn.

`python -m benchmarks.closed_loop` prints a table; without Exudyn it has the rows of flexarm alone.
All times are those of the integration on one core, the best of three.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

import flexarm as fa

LENGTHS, GROUND, RIGIDITY, DENSITY, GRAVITY = (0.3, 0.9, 0.7), 1.0, 200.0, 0.5, 9.81
#: Axial rigidity of a slender steel rod of this mass: enough not to count.
AXIAL = 1.3e7
DURATION, RATE = 1.0, 100
CRANK, TURN = 0.7, 12.0  # rad, rad/s
#: Settings of flexarm: segments and modes of a link, and relative tolerance.
SETTINGS = ((1, 2, 1e-3), (1, 3, 1e-3), (1, 3, 1e-5), (2, 3, 1e-5))
EXUDYN = ((4, 1e-3), (4, 5e-4), (4, 2.5e-4), (8, 2.5e-4))
#: Settings of the reference.
FINEST = (4, 3, 1e-7)


def four_bar(segments: int, modes: int) -> fa.Arm:
    """Return the mechanism in the second-order theory."""
    bar = {"flexural_rigidity": RIGIDITY, "mass_per_length": DENSITY, "segments": segments}
    links = [
        fa.Link(length=length, modes=modes, elements=4 * segments, **bar) for length in LENGTHS
    ]
    links[2] = links[2].replace(parent=0)
    return fa.Arm(
        links=links,
        joints=[fa.Joint(), fa.Joint(), fa.Joint(offset=(GROUND, 0.0))],
        closures=[fa.Closure(link=2, to_link=3)],
        gravity=(0.0, -GRAVITY),
        theory="second_order",
    )


def prepared(segments: int, modes: int, rtol: float) -> Callable[[], np.ndarray]:
    """Return a function that integrates the mechanism and gives the path of the rocker's tip."""
    arm = four_bar(segments, modes)
    start = fa.assembled(arm, arm.rest([CRANK, -0.4, 1.7]), arm.rest([TURN, 0.0, 0.0]), held=[1])

    def run() -> np.ndarray:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.LargeDeflectionWarning)
            result = fa.simulate(
                arm,
                DURATION,
                initial=start.q,
                initial_rate=start.qd,
                rate=RATE,
                rtol=rtol,
                integrator="kennedy_carpenter_5",
            )
        return np.asarray(result.tip.values)

    return run


def exudyn(elements: int, step: float) -> Callable[[], np.ndarray]:
    """Return the same of Exudyn."""
    from peers.four_bar import FourBar, prepare

    arm = four_bar(1, 3)
    start = fa.assembled(arm, arm.rest([CRANK, -0.4, 1.7]), arm.rest([TURN, 0.0, 0.0]), held=[1])
    angles, rates = (values[arm.joint_index] for values in (start.q, start.qd))
    case = FourBar(
        lengths=LENGTHS,
        ground=GROUND,
        flexural_rigidity=RIGIDITY,
        axial_rigidity=AXIAL,
        mass_per_length=DENSITY,
        gravity=GRAVITY,
        angles=(angles[0], angles[0] + angles[1], angles[2]),
        rates=(rates[0], rates[0] + rates[1], rates[2]),
        duration=DURATION,
        rate=RATE,
    )
    return prepare(case, elements, step)


def rows() -> Iterator[tuple[str, float, float]]:
    """Yield name, largest error (m) and time (s)."""
    finest = prepared(*FINEST)()
    entries: list[tuple[str, Callable[[], Callable[[], np.ndarray]]]] = [
        (f"flexarm, {k} segments of {m} modes, rtol {rtol:g}", partial(prepared, k, m, rtol))
        for k, m, rtol in SETTINGS
    ]
    try:
        import exudyn as _exudyn  # noqa: F401

        entries += [
            (f"Exudyn, {k} elements, step {step:g} s", partial(exudyn, k, step))
            for k, step in EXUDYN
        ]
    except ImportError:
        print("Exudyn is not installed: rows of flexarm alone.")
    for name, make in entries:
        best, path = np.inf, finest
        make()()  # machine code
        for _ in range(3):
            run = make()
            started = time.perf_counter()
            path = run()
            best = min(best, time.perf_counter() - started)
        yield name, float(np.max(np.linalg.norm(path - finest, axis=1))), best


def main() -> None:
    """Print the table."""
    print("| program | largest error, m | time, ms |\n| --- | ---: | ---: |")
    for name, error, seconds in rows():
        print(f"| {name} | {error:.1e} | {1e3 * seconds:.3g} |", flush=True)


if __name__ == "__main__":
    main()
