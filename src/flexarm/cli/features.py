"""Small calls that together use every kernel, by feature, for the library of kernels."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from typing import Any

import flexarm as fa
from flexarm.base.errors import without_warnings
from flexarm.integrate import INTEGRATORS
from flexarm.kernels.compilation import jit
from flexarm.kernels.compilation.build import export, record
from flexarm.kernels.compilation.cache import compile_seconds
from flexarm.motion import Motion

_START, _END = [0.4, 0.6], [0.5, 0.5]
_SAMPLE_TIME = 0.004


@cache
def _arm() -> fa.Arm:
    gauge = fa.Gauge(station=0.1, distance=0.005)
    upper = fa.Link(length=0.8, flexural_rigidity=90.0, mass_per_length=0.5, elements=1)
    upper = upper.replace(gauges=[gauge], damping=fa.ModalDamping(ratio=0.01))
    lower = fa.Link(length=0.6, flexural_rigidity=60.0, mass_per_length=0.4, elements=1)
    joints = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05)]
    return fa.Arm(links=[upper, lower], joints=joints)


@cache
def _motion() -> Motion:
    return fa.joint_motion(_arm(), _START, _END, 0.1, start_time=0.5)


def _floor() -> fa.Contact:
    x, y, *_ = _arm().tip(_arm().rest(_START))
    return fa.Contact(fa.Wall((float(x), float(y) + 1e-4), (0.0, 1.0)), 1e4)


def _simulate() -> None:
    arm = _arm()
    torque = fa.rigid_torque(arm, _motion())
    result = fa.simulate(arm, 0.02, torque=torque, initial=arm.rest(_START))
    fa.simulate(arm, 0.02, torque=lambda t: [0.1, 0.0], stations=3)
    fa.simulate(arm.rigid(), 0.02)
    result.load()
    arm.energy(arm.rest(_START), arm.rest(_START))
    arm.mass_matrix(arm.rest(_START))


def _dynamics() -> None:
    arm = _arm()
    q, none = arm.rest(_START), [0.0] * arm.dof
    arm.forward_dynamics(q, none, [0.1, 0.0])
    arm.inverse_dynamics(q, none, none)
    arm.inverse_dynamics_many([q], [none], [none])
    arm.derivatives(q, none, [0.1, 0.0])
    arm.section_forces(q, none, none, stations=3)
    arm.joint_reactions(q, none, none)
    arm.shape(q, stations=3)
    arm.strain(q)
    arm.tip_velocity(q, none)


def _integrate(name: str) -> None:
    step = None if INTEGRATORS[name].adaptive else 1e-4
    fa.simulate(_arm(), 0.002, torque=lambda t: [0.1, 0.0], integrator=name, step=step)


def _loop() -> None:
    often = fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=2e-5)  # its law runs as a program
    for method in ("dormand_prince_8", "kennedy_carpenter_5"):
        _started(controller=often, integrator=method)
    _controlled(fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=_SAMPLE_TIME))
    _controlled(fa.ComputedTorque(_arm(), 0.3, 0.5, sample_time=_SAMPLE_TIME))


def _started(**options: Any) -> None:
    fa.simulate(_arm(), 0.02, **{"initial": _arm().rest(_START), **options})


def _controlled(controller: fa.Controller) -> None:
    _started(controller=controller, reference=_motion())


def _linearize() -> None:
    fa.modes(_arm())
    falling = fa.Arm(_arm().spec.model_copy(update={"gravity": (0.0, -9.81)}))
    fa.linearize(falling, fa.equilibrium(falling))
    fa.linearize(_arm(), outputs=[fa.Sensor("acceleration", 2)])


def _predictive_control() -> None:
    law = fa.NonlinearMPC(_arm(), _START, torque_limit=5.0, horizon=3, sample_time=_SAMPLE_TIME)
    _controlled(law)


def _adaptive_control() -> None:
    _controlled(fa.Adaptive(_arm(), 2.0, [0.8, 0.2], 0.003, sample_time=_SAMPLE_TIME))
    _controlled(fa.RBFAdaptive(_arm(), 8.0, [0.8, 0.3], 0.001, -1.0, 1.0, sample_time=_SAMPLE_TIME))
    held = fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=_SAMPLE_TIME)
    _controlled(fa.DisturbanceObserver(_arm(), held, 0.2))
    _controlled(fa.IntegralResonantControl(_arm(), held))


def _force_control() -> None:
    pressed = fa.pressed_motion(_arm(), _motion(), 0.1, [0.0, 1.0], duration=0.1)
    law = fa.HybridForce(_arm(), frequency=1.5, sample_time=_SAMPLE_TIME)
    start = pressed.initial
    _started(controller=law, reference=pressed, contacts=[_floor()], initial=start)


def _estimate() -> None:
    felt = fa.Sensor("acceleration", 2)
    instruments = [
        fa.Instrument("joint_angle", noise=1e-4),
        fa.Instrument(felt, noise=0.01, name="felt"),
    ]
    read = fa.Hardware([fa.Instrument("joint_angle", rate_cutoff=50.0), fa.Instrument("torque")])
    fa.simulate(_arm(), 0.01, controller=fa.JointPD(1.0, 1.0), hardware=read)
    observer = fa.ExtendedKalmanFilter(
        _arm(), instruments, sample_time=_SAMPLE_TIME, payload_deviation=0.1
    )
    observer.run([[0.0, 0.0]] * 2, {"joint_angle": [_START] * 2, "felt": [[0.0, 0.0]] * 2})
    q = _arm().rest(_START)
    for method in ("rk4", "kennedy_carpenter_5"):
        fa.step_jacobian(_arm(), q, q, [0.0, 0.0], 1e-4, method=method)


def _mechanism() -> None:
    bars = [fa.Link(length=length, flexural_rigidity=90.0, mass_per_length=0.5, elements=1)
            for length in (0.3, 0.9, 0.7)]  # fmt: skip
    bars[2] = bars[2].replace(parent=0)
    joints = [fa.Joint(), fa.Joint(), fa.Joint(offset=(1.0, 0.0))]
    loop = fa.Arm(links=bars, joints=joints, closures=[fa.Closure(link=2, to_link=3)])
    start = fa.assembled(loop, loop.rest([1.0, -0.5, 1.6]))
    fa.simulate(loop, 0.01, initial=start.q, initial_rate=start.qd)
    fa.linearize(loop, fa.equilibrium(loop, start.q[loop.joint_index]))


def _sense() -> None:
    sensors = [fa.Sensor("acceleration", 2), fa.Sensor("velocity", 2)]
    falling = fa.Arm(_arm().spec.model_copy(update={"gravity": (0.0, -9.81)}))
    fa.linearize(falling, fa.equilibrium(falling, _START, contacts=[_floor()]))
    held = fa.JointPD([8.0, 3.0], [0.8, 0.3], sample_time=_SAMPLE_TIME)
    felt = fa.Hardware(
        [
            fa.Instrument("joint_angle", rate_cutoff=50.0),
            *(fa.Instrument(s, name=s.kind) for s in sensors),
        ]
    )
    _started(controller=held, reference=_motion(), hardware=felt)


def _invert() -> None:
    fa.tip_inversion(_arm(), _motion())
    fa.linearize_along(_arm(), _motion(), rate=3.0)


def _batch() -> None:
    starts = [_arm().rest(_START)] * 2
    for integrator in ("dormand_prince_8", "kennedy_carpenter_5"):
        fa.simulate_batch(_arm(), 0.01, initial=starts, integrator=integrator, progress=False)
        heavier = {"payload.mass": [0.0, 0.1]}
        fa.simulate_batch(_arm(), 0.01, parameters=heavier, integrator=integrator, progress=False)


def _differentiate() -> None:
    weights, torque = {"tip": [[0.0, 0.0]] * 3}, [[0.1, 0.0]] * 3
    for name in ("auto", "kennedy_carpenter_5"):  # the others are rare, and compile as slowly
        fa.sensitivities(_arm(), 0.002, ["payload.inertia"], integrator=name)
        fa.goal_gradient(_arm(), 0.002, weights, torque=torque, integrator=name)


#: Calls by name.
FEATURES: dict[str, Callable[[], None]] = {
    "derivatives of runs": _differentiate,
    "batches": _batch,
    "forward dynamics and derivatives": _dynamics,
    "simulate": _simulate,
    **{f"integrator {name}": partial(_integrate, name) for name in INTEGRATORS},
    "force control": _force_control,
    "state estimation": _estimate,
    "tip inversion": _invert,
    "linearize and modes": _linearize,
    "contacts": lambda: _started(contacts=[_floor()]),
    "adaptive control": _adaptive_control,
    "nonlinear predictive control": _predictive_control,
    "linear control": lambda: _controlled(fa.LQG(_arm(), _START, sample_time=_SAMPLE_TIME)),
    "closed loops": _loop,
    "mechanisms": _mechanism,
    "sensors and contacts in linear models": _sense,
    "prescribed joints": lambda: _started(prescribed={1: fa.PrescribedAngle.hold(0.4)}),
}


def groups() -> list[list[str]]:
    """Return the names of features, those together whose kernels have numbers of the same type.

    A process compiles a group, because processes cannot share kernels; the longest comes first.
    """
    special: list[str] = [name for name in ("derivatives of runs", "batches") if name in FEATURES]
    others = [name for name in FEATURES if name not in special]
    ordered: list[list[str]] = [special[:1], others, special[1:]]
    return [group for group in ordered if group]


def compile_features(names: list[str], folder: Path | None, every: bool) -> float:
    """Compile the kernels of features; return the time, s. Export them to a folder, if given."""
    jit.notice.silent = True
    if folder is not None:
        record(folder)
    before = compile_seconds()
    for name in names:
        with without_warnings():  # they concern the example arm
            FEATURES[name]()
        if folder is not None:
            export(folder, every)
    return compile_seconds() - before
