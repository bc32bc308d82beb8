"""Loops with a typical drive, of designs with and without its hardware: theory/control-linear.md.

    python docs/performance/measure_designs_with_hardware.py

30 arms of `benchmarks.unfamiliar_arms` with one to three links. The motors are late by a sample and
lag by 1 to 2 ms, encoders have 17 bits and rates filtered at 100 Hz.
"""

import math
import sys
import warnings
from pathlib import Path

import numpy as np

import flexarm as fa

sys.path.insert(0, str(Path(__file__).parents[2]))
from benchmarks.unfamiliar_arms import draw

TICK = 1e-3
RATES = {"measured": {"joint_angle": 1e-4, "joint_rate": 1e-2}}
LAWS = {
    "LQG": (fa.LQG, {}, TICK),
    "LQG, measured rates": (fa.LQG, RATES, TICK),
    "MPC": (fa.MPC, {"torque_limit": 1e9}, 2 * TICK),
    "Composite": (fa.Composite, {}, TICK),
    "LoopShaping": (fa.LoopShaping, {}, TICK),
}


def drive(arm, seed, tick):
    """Return the hardware of a typical drive."""
    lag = float(np.random.default_rng([seed, 7]).uniform(1e-3, 2e-3))
    encoder = fa.Instrument("joint_angle", resolution=2.0 * math.pi / 2**17, rate_cutoff=100.0)
    gauges = [fa.Instrument("strain")] * bool(arm.gauges)
    motors = fa.Motors(delay=tick, time_constant=lag)
    return fa.Hardware(instruments=[encoder, *gauges], motors=motors)


def row(name):
    """Return the loops (design, arm): growth in 1/s and disk margin; the first is the ideal one."""
    kind, given, tick = LAWS[name]
    found = []
    for seed in (seed for seed in range(40) if seed % 4 < 3):
        arm = draw(seed).arm
        posture = [0.0] + [0.5] * (arm.n_joints - 1)
        hardware = drive(arm, seed, tick)
        late = hardware.motors.delay + hardware.motors.time_constant
        designs = [({}, None), ({}, hardware), ({"hardware": hardware}, hardware)]
        if kind is not fa.MPC:
            designs.insert(2, ({"delay": late}, hardware))
        loops = []
        for more, simulated in designs:
            law = kind(arm, posture, sample_time=tick, **given, **more)
            margins = fa.loop_margins(law, arm, [posture], hardware=simulated)
            loops.append((margins.growth.item(), float(margins.disk_margin.min())))
        found.append(loops)
    return np.moveaxis(np.array(found), 0, 1)


def main():
    """Print the stable loops of 30, and the medians of their disk margins."""
    warnings.simplefilter("ignore", fa.FlexarmWarning)
    for name in LAWS:
        loops = row(name)
        cells = [f"{np.sum(each[:, 0] < 0.0):3d} ({np.median(each[:, 1]):.2f})" for each in loops]
        print(f"{name:22}", *cells, sep="  ", flush=True)


if __name__ == "__main__":
    main()
