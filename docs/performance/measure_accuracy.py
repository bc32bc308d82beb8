"""Tables "requested", "rough" and "quantities" of accuracy.md: runs with an accuracy, or none.

The arms are those of ``tests/accuracy_runs.py``, of one to three links, and the smooth ones of
``measure_default_step``, many of which turn and whirl fast. The cost is the number of
evaluations of all runs of a call, over that of a call whose runs have small tolerances.

    python docs/performance/measure_accuracy.py [ARMS]
"""

from __future__ import annotations

import itertools
import sys
import warnings
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from unittest import mock

import numpy as np
import xarray as xr

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from measure_default_step import cases

import flexarm as fa
import flexarm.simulation.run.coarse as coarse
from accuracy_runs import QUIET, random_arm
from flexarm.simulation.histories.piecewise import PiecewiseCubic

ARMS, WHIRLING = 30, 60
#: Accuracies over the reach; None for a call without one.
PARTS = (1e-3, 1e-4, 1e-5, 1e-6, None)
#: Duration (s) of the runs of each kind of arm.
KINDS = {"damping ratio 2 %": 1.0, "no damping": 1.0, "whirling": 0.5}
#: Channels beside the tip, of the second table.
QUANTITIES = "tip_velocity", "link_tip_deflection", "kinetic_energy", "joint_force"
Drawn = tuple[fa.Arm, dict[str, object]]


def arms(kind: str, count: int) -> Iterator[Drawn]:
    """Yield arms of a kind, and the arguments of their runs."""
    if kind == "whirling":
        smooth = (case for case in cases(count) if coarse.is_smooth(case.arm))
        yield from ((case.arm, case.settings | {"duration": KINDS[kind]}) for case in smooth)
        return
    for seed in range(count):
        arm, torque = random_arm(seed)
        if kind == "no damping":
            links = [link.replace(damping=None) for link in arm.spec.links]
            arm = fa.Arm(links=links, joints=arm.spec.joints)
        yield arm, {"torque": torque, "duration": KINDS[kind]}


def measure(
    arm: fa.Arm, parts: tuple[float | None, ...] = PARTS, **arguments: object
) -> np.ndarray:
    """Return cost, error over accuracy, and error over its estimate, (parts, 3)."""

    def run(**how: float) -> object:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", fa.FlexarmWarning)  # arms that bend far
            return fa.simulate(arm, **arguments, **how, **QUIET)

    exact, reach, rows = run(rtol=1e-11), float(arm.lengths.sum()), []
    for part in parts:
        how = {} if part is None else {"accuracy": part * reach}
        result = run(**how)
        with mock.patch.object(coarse, "_LEAST", np.inf):
            close = run(**how)
        apart = np.linalg.norm((result.tip - exact.tip).values, axis=1).max()
        cost = result.attrs["evaluations"] / close.attrs["evaluations"]
        accuracy = reach * (1e-5 if part is None else part)
        estimate = result.attrs.get("integration_error")
        rows.append([cost, apart / accuracy, apart / estimate if estimate else np.nan])
    return np.array(rows)


def table(count: int) -> str:
    lines = ["| arms | accuracy over reach | cost | error over accuracy | error over estimate |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for kind in KINDS:
        drawn = arms(kind, count * WHIRLING // ARMS if kind == "whirling" else count)
        rows = np.stack([measure(arm, **arguments) for arm, arguments in drawn])
        for part, values in zip(PARTS, np.moveaxis(rows, 1, 0), strict=True):
            middle, most = np.nanmedian(values, axis=0), np.nanmax(values, axis=0)
            cells = [f"{a:.2f}, {b:.2f}" for a, b in zip(middle, most, strict=True)]
            name = "default" if part is None else f"{part:.0e}"
            lines.append(f"| {kind} ({len(rows)}) | {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def quantity_errors(result: xr.Dataset, exact: xr.Dataset) -> list[float]:
    """Return largest errors of the `QUANTITIES` of a run, over their largest values."""
    return [
        float(np.abs(result[name] - exact[name]).max() / np.abs(exact[name]).max())
        for name in QUANTITIES
    ]


def quantity_table(count: int) -> str:
    """Return the table of quantities that no accuracy is promised for."""
    heads = [name.replace("_", " ") for name in QUANTITIES]
    lines = [f"| arms | call | {' | '.join(heads)} |", "| --- " * (2 + len(heads)) + "|"]
    for kind in list(KINDS)[:2]:
        rows: dict[str, list[list[float]]] = {"default": [], "`rtol=1e-7`": []}
        for arm, arguments in arms(kind, count):
            exact = fa.simulate(arm, rtol=1e-11, **arguments, **QUIET)
            for name, how in zip(rows, ({}, {"rtol": 1e-7}), strict=True):
                result = fa.simulate(arm, **how, **arguments, **QUIET)
                rows[name].append(quantity_errors(result, exact))
        for name, errors in rows.items():
            middle, most = np.median(errors, axis=0), np.max(errors, axis=0)
            cells = [f"{a:.0e}, {b:.0e}" for a, b in zip(middle, most, strict=True)]
            lines.append(f"| {kind} ({count}) | {name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def rough_run(seed: int, noisy: bool) -> Drawn:
    """Return an arm with links of 6 Hz to 1 kHz, and torques of samples at 1 kHz."""
    rng = np.random.default_rng(seed)
    n, length, frequency = (
        rng.integers(1, 3),
        10 ** rng.uniform(-0.5, 0.5),
        10 ** rng.uniform(0.8, 3),
    )
    mass, damped = 0.5 * length, rng.random() < 0.7
    link = fa.Link(
        length=length,
        flexural_rigidity=mass * (2 * np.pi * frequency) ** 2 * length**4 / 3.516**2,
        mass_per_length=mass,
        elements=int(rng.integers(1, 4)),
        damping=fa.ModalDamping(ratio=0.01) if damped else None,
    )
    arm = fa.Arm(links=[link] * n, joints=[fa.Joint(hub_inertia=0.3 * mass * length**3)] * n)
    times, size = np.arange(1001)[:, None] / 1e3, mass * length**3 * rng.uniform(1, 5)
    sine = np.sin(2 * np.pi * rng.uniform(1, 4, n) * times + 1e-3)
    jumps = np.sign(times - rng.uniform(0.2, 0.8, n)), np.sign(sine), sine + (times > 0.41)
    noise = sine + 10.0 ** -(1 + seed % 5) * rng.standard_normal((1001, n))
    torque = size * (noise if noisy else jumps[seed % 3])
    return arm, {"torque": torque, "duration": 1.0}


def rough_table(count: int) -> str:
    """Return the table of runs whose torque has samples that jump, or noise of 1e-5 to 0.1."""
    lines = ["| samples of the torque | steps end at them | error over reach | evaluations |"]
    lines.append("| --- | --- | --- | --- |")
    passed = mock.patch.object(PiecewiseCubic, "stopping_where_rough", lambda history, _: history)
    for noisy, where in itertools.product((False, True), (nullcontext(), passed)):
        errors, works = [], []
        for arm, arguments in (rough_run(seed, noisy) for seed in range(count)):
            exact = fa.simulate(arm, integrator="kennedy_carpenter_5", rtol=1e-12, **arguments)
            with where:
                result = fa.simulate(arm, **arguments)
            apart = np.abs(result.tip - exact.tip).values.max()
            errors.append(apart / arm.lengths.sum())
            works.append(result.attrs["evaluations"])
        kind, stops = ("jumps", "noise")[noisy], ("yes", "no")[where is passed]
        cells = f"{np.median(errors):.1e}, {max(errors):.1e} | {np.mean(works):.0f}"
        lines.append(f"| {kind} ({count}) | {stops} | {cells} |")
    return "\n".join(lines)


if __name__ == "__main__":
    arms_of_a_kind = int(sys.argv[1]) if len(sys.argv) > 1 else ARMS
    print(table(arms_of_a_kind), quantity_table(arms_of_a_kind), sep="\n\n")
    print(rough_table(3 * arms_of_a_kind))
