"""Entries of a work-precision diagram: flexarm and every installed peer."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from peers.arms import Case
from peers.flexarm_arm import Torque
from scipy.integrate import solve_ivp

import flexarm as fa
from benchmarks.work_precision import Entry, Outcome, Run, timed
from flexarm.simulation.run.settings import RunSettings, tolerances_of

#: Module that each program needs in addition to the dependencies of flexarm.
PEERS = {
    "Exudyn": "exudyn",
    "MuJoCo": "mujoco",
    "Pinocchio": "pinocchio",
    "Drake": "pydrake",
    "PyElastica": "elastica",
    "SoRoMoX": "soromox",
    "CasADi CVODES": "casadi",
    "JAX": "diffrax",
}


#: Setting of an entry without arguments: the accuracy that a user gets.
DEFAULTS = "default arguments"


def missing() -> list[str]:
    """Return the names of the peers that are not installed."""
    return [name for name, module in PEERS.items() if importlib.util.find_spec(module) is None]


def arm_of(case: Case, **options: Any) -> fa.Arm:
    """Return the arm of a case; ``options`` are those of the links, and ``theory``."""
    theory = options.pop("theory", "linear")
    links = [
        fa.Link(
            length=length,
            flexural_rigidity=case.flexural_rigidity,
            mass_per_length=case.mass_per_length,
            **{"elements": 1, **options},
        )
        for length in case.lengths
    ]
    return fa.Arm(links=links, gravity=(0.0, -case.gravity), theory=theory)


def flexarm(case: Case, basis: str, build: Callable[[], fa.Arm], truth: str, **how: Any) -> Entry:
    """Return the entry of flexarm with a basis and arguments of ``flexarm.simulate``.

    The label of default arguments has the tolerances that ``flexarm.simulate`` derives from them.
    """

    def prepare() -> Run:
        arm = build()
        return lambda: simulate(case, arm, **how)

    name = how.get("integrator", "auto")
    if "step" in how:
        fixed = [f"step {how['step']:g} s"]
    elif "rtol" in how:
        fixed = [tolerances(how["rtol"])]
    else:
        relative, absolute, length = tolerances_of(RunSettings(), build())
        fixed = [f"{DEFAULTS}: rtol {relative:.0e}, atol {absolute * length:.0e} m"]
    specialized = ["for its size"] if how.get("specialized") else []
    return Entry("flexarm", ", ".join([name, basis, *fixed, *specialized]), truth, prepare)


def tolerances(rtol: float, unit: str = " m") -> str:
    """Return the label of a relative tolerance and the absolute one, in all programs 1e-2 of it.

    The unit is that of displacements of the tip; other programs measure each coordinate.
    """
    return f"rtol {rtol:.0e}, atol {1e-2 * rtol:.0e}{unit}"


def simulate(case: Case, arm: fa.Arm, **how: Any) -> Outcome:
    """Run flexarm; the time is that of its compiled integration."""
    if "rtol" in how:
        how = {**how, "atol": 1e-2 * how["rtol"]}
    result = fa.simulate(
        arm,
        case.duration,
        torque=Torque(case),
        initial=arm.rest(case.joint_angles),
        rate=case.rate,
        progress=False,
        **how,
    )
    return Outcome(result["tip"].values, result.attrs["wall_seconds"])


def exudyn(case: Case, elements: int, step: float, truth: str) -> Entry:
    """Return the entry of Exudyn with cable elements for large deflection."""

    def prepare() -> Run:
        from peers import exudyn_arm

        return timed(exudyn_arm.prepare(case, elements, step))

    return Entry("Exudyn", f"{elements} ANCF cables a link, step {step:g} s", truth, prepare)


def exudyn_exact(case: Case, elements: int, step: float, truth: str) -> Entry:
    """Return the entry of Exudyn with geometrically exact elements of three nodes."""

    def prepare() -> Run:
        from peers import exudyn_arm

        return timed(exudyn_arm.prepare(case, elements, step, exact=True))

    setting = f"{elements} exact beam elements a link, step {step:g} s"
    return Entry("Exudyn", setting, truth, prepare)


def mujoco(case: Case, segments: int, step: float, truth: str) -> Entry:
    """Return the entry of MuJoCo with rigid bars on springs."""

    def prepare() -> Run:
        from peers import mujoco_arm

        return timed(mujoco_arm.prepare(case, segments, step))

    return Entry("MuJoCo", f"{segments} bars a link, RK4 step {step:g} s", truth, prepare)


def pinocchio(case: Case, segments: int, step: float, truth: str) -> Entry:
    """Return the entry of Pinocchio: rigid bars on springs, integrated by a loop in Python."""

    def prepare() -> Run:
        from peers import pinocchio_arm

        return timed(pinocchio_arm.prepare(case, segments, step))

    return Entry("Pinocchio", f"{segments} bars a link, RK4 step {step:g} s", truth, prepare)


def drake(case: Case, segments: int, accuracy: float, longest: float, truth: str) -> Entry:
    """Return the entry of Drake with rigid bars on springs."""

    def prepare() -> Run:
        from peers import drake_arm

        return timed(drake_arm.prepare(case, segments, accuracy, longest))

    setting = f"{segments} bars a link, RK3 accuracy {accuracy:.0e}, steps to {longest:g} s"
    return Entry("Drake", setting, truth, prepare)


def pyelastica(
    case: Case, elements: tuple[int, ...], radius: float, step: float, truth: str
) -> Entry:
    """Return the entry of PyElastica with a Cosserat rod that is thicker than the links."""

    def prepare() -> Run:
        from peers import elastica_arm

        return timed(elastica_arm.prepare(case, elements, radius, step))

    pieces = "+".join(map(str, elements))
    setting = f"{pieces} elements, radius {1e3 * radius:g} mm, step {step:g} s"
    return Entry("PyElastica", setting, truth, prepare)


def soromox(case: Case, segments: int, rtol: float, truth: str) -> Entry:
    """Return the entry of SoRoMoX with segments of constant curvature."""

    def prepare() -> Run:
        from peers import soromox_arm

        return timed(soromox_arm.prepare(case, segments, rtol))

    setting = f"{segments} constant curvatures a link, Tsit5, {tolerances(rtol, '')}"
    return Entry("SoRoMoX", setting, truth, prepare)


def casadi(case: Case, arm: fa.Arm, rtol: float, truth: str) -> Entry:
    """Return the entry of CVODES, through CasADi, for the equations of ``arm``."""

    def prepare() -> Run:
        from benchmarks import casadi_cvodes

        return timed(casadi_cvodes.prepare(case, arm, rtol), lambda states: tips(arm, states))

    return Entry("CasADi CVODES", tolerances(rtol, ""), truth, prepare)


def jax(
    case: Case, arm: fa.Arm, truth: str, step: float | None = None, rtol: float | None = None
) -> Entry:
    """Return the entry of JAX for the equations of ``arm``: fixed steps, or Diffrax."""

    def prepare() -> Run:
        from benchmarks import jax_diffrax

        return timed(jax_diffrax.prepare(case, arm, step, rtol), lambda states: tips(arm, states))

    setting = f"RK4 step {step:g} s" if step else f"Diffrax Dopri8, {tolerances(rtol, '')}"
    return Entry("JAX", setting, truth, prepare)


def scipy(case: Case, arm: fa.Arm, method: str, rtol: float, truth: str) -> Entry:
    """Return the entry of a SciPy solver that calls flexarm's dynamics from Python."""
    n = arm.dof
    samples = np.arange(case.samples) / case.rate

    def rates(t: float, y: np.ndarray) -> np.ndarray:
        return np.concatenate([y[n:], arm.forward_dynamics(y[:n], y[n:], case.torque(t))])

    def integrate() -> np.ndarray:
        start = np.concatenate([arm.rest(case.joint_angles), np.zeros(n)])
        span, tolerance = (0.0, case.duration), {"rtol": rtol, "atol": 1e-2 * rtol}
        return solve_ivp(rates, span, start, method=method, t_eval=samples, **tolerance).y.T

    return Entry(
        f"SciPy {method}",
        tolerances(rtol, ""),
        truth,
        lambda: timed(integrate, lambda states: tips(arm, states)),
    )


def tips(arm: fa.Arm, states: np.ndarray) -> np.ndarray:
    """Return tip positions (samples, 2) of states (samples, 2 dof)."""
    return np.array([arm.tip(q)[:2] for q in states[:, : arm.dof]])
