"""Controllers that `flexarm.design` alone proposes for unfamiliar arms with real drives.

Each arm is drawn from a seed: reach 0.3 to 15 m, one to four links, with and without gravity,
direct drives and gears with friction, encoders, gauges, delays and limits of the motors. The design
has the data sheet: the arm with its nominal payload, the hardware, and the uncertainty. Its
proposal then runs on plants with any payload from none to twice the nominal one, and with any
rigidity within 20 % for each link. A study file has one arm, so this is a script.

    python -m benchmarks.unfamiliar_arms FIRST LAST [TASK [FILE]]

The rows are appended to a file, from which an interrupted bench goes on.
"""

from __future__ import annotations

import json
import math
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import flexarm as fa
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.model import PlantSpec, StudySpec
from flexarm.simulation.calls.metrics import MEASURED

#: Largest settled error and residual vibration, relative to the reach; largest RMS error of a line,
#: likewise, and of a force, relative to it.
REQUIRED = 1e-3
TRACKED, PRESSED = 0.01, 0.05
#: Uncertainty of payload and rigidity, and random plants of each arm beside the two corners.
PAYLOAD, RIGIDITY, PLANTS = 1.0, 0.2, 4
_GRAVITY = 9.81
#: A run is unstable if its vibration exceeds the requirement and, in the second half of the time
#: after the motion, this share of that in the first half.
_KEPT = 0.9


class Case(NamedTuple):
    """An arm, its drives, and its kind in words."""

    arm: fa.Arm
    hardware: fa.Hardware
    kind: str


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.random())


def draw(seed: int) -> Case:
    """Draw an arm; sixteen seeds in a row have all numbers of links, drives and both gravities."""
    rng = np.random.default_rng(seed)
    count, heavy, geared = 1 + seed % 4, seed // 4 % 2, seed // 8 % 2
    reach = 0.3 * 50.0 ** ((0.618034 * seed + 0.3) % 1.0)
    lengths = rng.uniform(0.6, 1.0, count)
    lengths *= reach / lengths.sum()
    # The mass grows with the square of the size, the frequency falls with its root: a link of
    # another size then sags by the same share of its length.
    density = reach * _log_uniform(rng, 0.5, 2.0) * 0.6 ** np.arange(count)
    rigidity = density * 0.4 ** np.arange(count)
    frequency = _log_uniform(rng, 3.0, 9.0) / math.sqrt(reach)
    payload = _log_uniform(rng, 0.05, 0.4) * float(density @ lengths)
    damping = fa.ModalDamping(ratio=_log_uniform(rng, 0.004, 0.02))
    joints: list[dict[str, Any]] = [{} for _ in lengths]
    limit = np.zeros(count)
    outer, moment, inertia = payload, 0.0, 0.0
    for k in reversed(range(count)):
        length, mass = lengths[k], density[k] * lengths[k]
        inertia += outer * length**2 + 2.0 * length * moment + mass * length**2 / 3.0
        moment += outer * length + mass * length / 2.0
        outer += mass
        joint = {"hub_inertia": inertia * _log_uniform(rng, 0.02, 0.2)}
        if k:  # the motor of the next link, at the tip of this one
            joint |= {"mass": 0.3 * outer, "housing_inertia": joint["hub_inertia"]}
        holding = _GRAVITY * moment * heavy
        turning = inertia * (2.0 * math.pi * frequency) ** 2
        if geared:
            ratio = float(round(_log_uniform(rng, 40.0, 160.0)))
            joint["gear_ratio"] = ratio
            joint["rotor_inertia"] = inertia * _log_uniform(rng, 0.1, 1.0) / ratio**2
            coulomb = _log_uniform(rng, 0.002, 0.01) * (holding + 0.1 * turning)
            joint["friction"] = fa.Friction(coulomb=coulomb, viscous=coulomb)
        limit[k] = 3.0 * holding + 0.2 * turning
        joints[k] = joint
        outer += joint.get("mass", 0.0)
    gauged = bool(heavy or rng.random() < 0.5)

    def scaled(factor: float, gravity: float) -> fa.Arm:
        links = [
            fa.Link(
                length=length,
                flexural_rigidity=factor * bending,
                mass_per_length=mass,
                elements=2,
                damping=damping,
                gauges=[fa.Gauge(station=0.02 * length, distance=0.01 * length)] * gauged,
            )
            for length, bending, mass in zip(lengths, rigidity, density, strict=True)
        ]
        return fa.Arm(
            links=links,
            joints=[fa.Joint(**joint) for joint in joints],
            payload=fa.Payload(mass=payload),
            gravity=(0.0, -gravity),
        )

    posture = [0.0] + [0.5] * (count - 1)
    lowest = float(fa.modes(scaled(1.0, 0.0), posture).frequency_hz.min())
    arm = scaled((frequency / lowest) ** 2, _GRAVITY * heavy)
    bits = int(rng.integers(16, 21))
    instruments = [
        fa.Instrument(
            "joint_angle",
            resolution=2.0 * math.pi / 2**bits,
            rate_cutoff=float(rng.choice([80.0, 150.0])),
        )
    ]
    if gauged:
        instruments.append(fa.Instrument("strain", noise=2e-6))
    motors = fa.Motors(
        delay=_log_uniform(rng, 5e-4, 3e-3),
        time_constant=_log_uniform(rng, 3e-4, 2e-3),
        torque_limit=limit.tolist(),
    )
    kind = (
        f"{count} links, {reach:.2g} m, {frequency:.2g} Hz, {'gravity' * heavy or 'no gravity'}, "
        f"{'gears' if geared else 'direct'}{', gauges' * gauged}"
    )
    return Case(arm, fa.Hardware(instruments=instruments, motors=motors), kind)


def measure(seed: int, task: str = "point_to_point") -> dict[str, Any]:
    """Design a controller for an arm; return what its runs leave on the perturbed plants."""
    arm, hardware, kind = draw(seed)
    row: dict[str, Any] = {"seed": seed, "kind": kind, "law": "", "runs": []}
    started = time.perf_counter()
    uncertain = {"payload_uncertainty": PAYLOAD, "rigidity_uncertainty": RIGIDITY}
    try:
        proposal = fa.design(arm, task, hardware=hardware, progress=False, **uncertain)
    except fa.FlexarmError as error:
        return row | {"refusal": f"{type(error).__name__}: {error}"}
    row |= {"law": proposal.chosen, "refusal": proposal.refusal}
    row["seconds"] = time.perf_counter() - started
    chosen = proposal.table.sel(candidate=proposal.chosen)
    row |= {name: float(chosen[name]) for name in ("disk_margin", "growth", "damping_ratio")}
    if not proposal.refusal:
        row["runs"] = list(runs_of(seed, task, proposal.scenario))
    return row


def plants_of(seed: int, links: int) -> dict[str, PlantSpec]:
    """Return plants by name: two corners of the uncertainty, and random ones."""
    rng = np.random.default_rng([seed, 1])
    plants = {
        "heavy, soft": (1.0 + PAYLOAD, [1.0 - RIGIDITY] * links),
        "light, stiff": (1.0 - PAYLOAD, [1.0 + RIGIDITY] * links),
    }
    for k in range(PLANTS):
        payload = rng.uniform(1.0 - PAYLOAD, 1.0 + PAYLOAD)
        rigidity = rng.uniform(1.0 - RIGIDITY, 1.0 + RIGIDITY, links).tolist()
        plants[f"random {k + 1}"] = payload, rigidity
    return {
        name: PlantSpec(payload_factor=payload, flexural_rigidity_factor=rigidity)
        for name, (payload, rigidity) in plants.items()
    }


def runs_of(seed: int, task: str, scenario: Any) -> Iterator[dict[str, Any]]:
    """Yield errors, relative to the requirements, and warnings of the runs of a proposal."""
    plants = plants_of(seed, len(scenario.arm.links))
    motion = getattr(scenario.motion, "path", scenario.motion)
    end, run = motion.start_time + motion.duration, scenario.run
    rest = run.duration - end
    settings = {"duration": run.duration, "rate": run.rate, "settling": 2.0 * rest / 3.0}
    shared = {"arm": scenario.arm, "hardware": scenario.hardware, "contacts": scenario.contacts}
    named = {"motions": {task: scenario.motion}, "drives": {"law": scenario.drive}}
    study = PreparedStudy(StudySpec(**shared, **named, plants=plants, run=settings))
    reach = study.arm.reach
    force = getattr(scenario.motion, "force", 1.0)
    for plant in plants:
        try:
            result, _ = study.one("law", plant, task)
        except fa.FlexarmError as error:
            yield {"plant": plant, "failure": str(error), "unstable": True, "warned": True}
            continue
        times = result["time"].values
        channels = {name: result[name].values for name in MEASURED if name in result}
        values = study.goal("law", task, times).metrics(channels)
        after = times >= (end if rest else 0.5 * end)
        tip = result["tip"].values[after, :2]
        early, late = (np.ptp(half, axis=0).max() for half in np.array_split(tip, 2))
        yield {
            "plant": plant,
            "settled": values["tip_error_settled"] / (reach * REQUIRED),
            "vibration": values["residual_vibration"] / (reach * REQUIRED),
            "tracked": values["tip_error_rms"] / (reach * TRACKED),
            "pressed": values["force_error_rms"] / (force * PRESSED),
            "saturation": float(result["saturation"].max()),
            "unstable": bool(late > max(_KEPT * early, reach * REQUIRED)),
            "warned": "nstable" in result.attrs["warning"],
        }


#: Errors that decide about the success of a run, by task.
DECIDING = {
    "point_to_point": ("settled", "vibration"),
    "track": ("tracked",),
    "force": ("pressed",),
}


def summary(rows: list[dict[str, Any]], task: str = "point_to_point") -> str:
    """Describe successes, errors and warnings."""
    refused = [row for row in rows if row["refusal"]]
    runs = [run for row in rows for run in row["runs"]]
    worst = [max(run.get(name, np.inf) for name in DECIDING[task]) for run in runs]
    good = sum(error <= 1.0 for error in worst)
    missed = sum(run["unstable"] and not run["warned"] for run in runs)
    false = sum(run["warned"] and not run["unstable"] for run in runs)
    text = f"{len(rows)} arms, {len(refused)} refused; {len(runs)} runs of the other arms"
    if not runs:
        return text
    return (
        f"{text}: {good} within the requirement, {sum(run['unstable'] for run in runs)} unstable; "
        f"warnings: {missed} missed, {false} false; error over the requirement: median "
        f"{np.median(worst):.2g}, worst {max(worst):.2g}"
    )


def rows_in(place: Path) -> dict[int, dict[str, Any]]:
    """Return the rows of a file by the number of their arm; none if it does not exist."""
    lines = place.read_text(encoding="utf-8").splitlines() if place.exists() else []
    return {row["seed"]: row for row in map(json.loads, lines)}


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    first, last = map(int, sys.argv[1:3])
    task, place = (*sys.argv[3:], *("point_to_point", "unfamiliar_arms.jsonl")[len(sys.argv) - 3 :])
    rows = rows_in(Path(place))
    for number in range(first, last):
        if number not in rows:
            rows[number] = measure(number, task)
            with open(place, "a", encoding="utf-8") as file:
                print(json.dumps(rows[number]), file=file)
    print(summary([rows[number] for number in range(first, last)], task))
