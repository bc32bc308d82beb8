"""True errors and costs of the models that `flexarm.converged` chooses, on random arms.

The truth is a fine model that the study never computes: twelve segments of two modes a link and the
second-order theory, or ten modes where modal damping does not permit segments (then without errors
by large deflection). The manual choice is the cheapest of all accurate models with equal links.
Cost: evaluations of the dynamics times coordinates.

    python -m benchmarks.converged FIRST LAST
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import flexarm as fa

DURATION, RATE = 0.5, 200.0
#: Accuracy over the reach: the default one.
ACCURACY = 1e-4


class Case(NamedTuple):
    """A random arm, its kind, and its torque."""

    arm: fa.Arm
    kind: str
    torque: Callable[[float], Any]
    angles: Any


def draw(seed: int) -> Case:
    """Draw one to three links of 1 to 30 Hz (clamped) and smooth torques that bend them."""
    rng = np.random.default_rng(seed)
    count = 1 + seed % 3
    damping: Any = (
        None,
        fa.RayleighDamping(stiffness_coefficient=1e-4),
        fa.ModalDamping(ratio=0.01),
    )
    damping = damping[rng.integers(3)]
    links, joints, stiffness = [], [], []
    for _ in range(count):
        length, mass = rng.uniform(0.5, 1.5), rng.uniform(0.2, 3.0)
        rigidity = (10 ** rng.uniform(0.8, 2.3) / 3.516) ** 2 * mass * length**3
        section = {"flexural_rigidity": rigidity, "mass_per_length": mass / length}
        links.append(fa.Link(length=length, damping=damping, **section))
        hub, motor = rng.uniform(0.005, 0.1), rng.uniform(0.1, 2.0) * rng.integers(2)
        hub *= seed % 5 != 4  # every fifth arm has joints without inertia
        joints.append(fa.Joint(hub_inertia=hub, mass=motor))
        stiffness.append((rigidity / length, mass * length**2))
    payload = fa.Payload(mass=rng.uniform(0.05, 1.0) * rng.integers(2))
    gravity = (0.0, -9.81 * rng.integers(2))
    theory = str(rng.choice(["linear", "second_order"]))
    arm = fa.Arm(links=links, joints=joints, payload=payload, gravity=gravity, theory=theory)
    bending, inertia = np.array(stiffness).T
    size = np.minimum(0.06 * bending, 6.0 * np.cumsum(inertia[::-1])[::-1])
    size *= rng.uniform(0.3, 1.0, count)
    rate, phase = rng.uniform(0.5, 2.0, count), rng.uniform(0.0, 0.5, count)
    torque = lambda t: size * np.sin(2.0 * np.pi * rate * t + phase)  # noqa: E731
    kind = "undamped" if damping is None else damping.kind
    kind = f"{kind}, {'no' if seed % 5 == 4 else 'with'} hub inertia"
    return Case(arm, kind, torque, rng.uniform(-np.pi, np.pi, count))


def simulated(case: Case, rtol: float, theory: str, **fields: Any) -> Any:
    """Simulate an arm with other fields of its links; return None if that fails."""
    try:
        links = [link.replace(**fields) for link in case.arm.spec.links]
        arm = fa.Arm(case.arm.spec.replace(links=links, theory=theory))
        settings = {"rate": RATE, "rtol": rtol, "progress": False, "specialized": False}
        start = arm.rest(case.angles)
        return arm.dof, fa.simulate(arm, DURATION, torque=case.torque, initial=start, **settings)
    except fa.FlexarmError:
        return None


def apart(result: Any, truth: Any) -> float:
    """Return the largest distance (m) of two tips."""
    return float(np.linalg.norm((result.tip - truth.tip).values[:, :2], axis=1).max())


def models(divisible: bool) -> list[dict[str, Any]]:
    """Return all manual choices."""
    sizes = [(1, m) for m in (1, 2, 3, 4, 6)] + ([(2, 2), (4, 2)] if divisible else [])
    meshes = [{"elements": 8, "segments": s, "modes": m} for s, m in sizes]
    rigid = {"flexible": False, "damping": None}
    return [{"theory": t, **mesh} for mesh in [rigid, *meshes] for t in ("linear", "second_order")]


def measure(seed: int) -> dict[str, Any]:
    """Return error and cost of the choice over the accuracy and over the best manual choice."""
    case = draw(seed)
    divisible = "modal" not in case.kind
    accuracy = ACCURACY * float(case.arm.lengths.sum())
    options = {"torque": case.torque, "rate": RATE, "progress": False, "specialized": False}
    started = time.perf_counter()
    choice = fa.converged(case.arm, DURATION, initial=case.arm.rest(case.angles), **options)
    seconds = time.perf_counter() - started
    # In the study, each run errs by a tenth of the accuracy at 1e-7: the truth by less.
    fine: dict[str, Any] = {"elements": 20, "modes": 10}
    if divisible:
        fine = {"elements": 24, "segments": 12, "modes": 2}
    solution = simulated(case, 1e-8, "second_order", **fine)
    runs = [simulated(case, 1e-7, **model) for model in models(divisible)]
    accurate = [
        dof * run.attrs["evaluations"]
        for dof, run in filter(None, runs)
        if solution is not None and apart(run, solution[1]) <= accuracy
    ]
    table = choice.table
    bending = table.segments * table.modes
    work = table.evaluations * (case.arm.n_joints + bending.sum("link"))
    plain = (table.modes == 2).all("link") & (table.segments == 1).all("link")
    reference = (plain & (table.theory == "second_order")).values
    cost = float(work[table.chosen.values][0])
    return {
        "kind": case.kind,
        "error": apart(choice.result, solution[1]) / accuracy if solution else np.nan,
        "estimate": choice.model_error / accuracy,
        "warned": not choice.converged,
        "cost": cost / min(accurate) if accurate else np.nan,
        "study": float(table.attrs["work"] / work[reference][0]),
        "runs": table.sizes["candidate"],
        "seconds": seconds,
    }


def summary(rows: list[dict[str, Any]]) -> str:
    """Describe errors, warnings and costs of some arms."""
    column = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    good = column["error"] <= 1.0
    cost = column["cost"][~column["warned"] & np.isfinite(column["cost"])]
    costs = f"{np.median(cost):.2g} (at most {cost.max():.2g})" if cost.size else "-"
    return (
        f"{len(rows)} arms: {(good & ~column['warned']).sum()} accurate, "
        f"{(~good & column['warned']).sum()} inaccurate and warned, "
        f"{(good & column['warned']).sum()} accurate and warned, "
        f"{(~good & ~column['warned']).sum()} inaccurate without a warning; cost over that of the "
        f"best manual choice {costs}; study over a run with two modes a link "
        f"{np.median(column['study']):.3g} (at most {column['study'].max():.3g}); "
        f"{np.median(column['seconds']):.2g} s (at most {column['seconds'].max():.2g} s)"
    )


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    measured = []
    for number in range(int(sys.argv[1]), int(sys.argv[2])):
        row = measure(number)
        measured.append(row)
        print(
            number,
            *(
                f"{name} {value:.3g}" if isinstance(value, float) else f"{name} {value}"
                for name, value in row.items()
            ),
            sep=", ",
            flush=True,
        )
    for kind in sorted({row["kind"] for row in measured}):
        print(f"{kind}:", summary([row for row in measured if row["kind"] == kind]))
    print("all:", summary(measured))
