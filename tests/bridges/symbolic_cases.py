"""Arms with parameters of every kind, for the bridges to CasADi and JAX."""

from __future__ import annotations

from typing import Any

import numpy as np

import flexarm as fa
from flexarm.model.paths import with_number
from random_options import Busy

#: Parameters of `parametric`, and the factors by which the tests change them.
PARAMETERS = {
    "links[0].flexural_rigidity": 1.3,
    "links[0].mass_per_length": 0.7,
    "links[0].damping.stiffness_coefficient": 1.9,
    "links[0].gauges[0].distance": 1.1,
    "links[1].material.density": 1.2,
    "links[1].material.youngs_modulus": 0.8,
    "links[1].section.width": 1.4,
    "links[1].damping.ratio[1]": 2.0,
    "joints[0].damping": 1.5,
    "joints[0].hub_inertia": 0.6,
    "joints[0].friction.coulomb": 0.5,
    "joints[0].friction.smoothing_rate": 1.5,
    "joints[1].mass": 1.2,
    "joints[1].stiffness": 1.2,
    "joints[1].rotor_inertia": 0.7,
    "joints[1].gear_ratio": 1.1,
    "joints[1].limits.stiffness": 1.3,
    "payload.mass": 2.0,
    "payload.inertia": 0.5,
    "payload.offset[1]": -1.0,
    "gravity[1]": 0.9,
}


def parametric(theory: str) -> fa.Arm:
    """Return two links that have every kind of number that can be a parameter."""
    return fa.Arm(
        links=[
            fa.Link(
                length=0.8,
                flexural_rigidity=20.0,
                mass_per_length=0.5,
                elements=2,
                segments=2,
                damping=fa.RayleighDamping(stiffness_coefficient=1e-4),
                gauges=[fa.Gauge(station=0.1, distance=0.004)],
            ),
            fa.Link(
                length=0.6,
                material="aluminium",
                section=fa.Rectangle(width=0.04, height=0.01),
                elements=2,
                modes=2,
                damping=fa.ModalDamping(ratio=[0.01, 0.02]),
            ),
        ],
        joints=[
            fa.Joint(
                hub_inertia=0.01,
                damping=0.1,
                friction=fa.Friction(coulomb=0.3, static=0.5, smoothing_rate=0.5),
            ),
            fa.Joint(
                mass=0.3,
                stiffness=40.0,
                rotor_inertia=1e-4,
                gear_ratio=30.0,
                limits=fa.JointLimits(lower=-0.2, upper=0.4, stiffness=50.0, damping=0.3),
            ),
        ],
        payload=fa.Payload(mass=0.2, inertia=0.001, offset=(0.05, -0.02)),
        gravity=(1.0, -9.0),
        theory=theory,
    )


def changed(arm: fa.Arm) -> tuple[np.ndarray, fa.Arm]:
    """Return other values of `PARAMETERS`, and the arm with these values."""
    spec, values = arm.spec, []
    for path, factor in PARAMETERS.items():
        value: Any = arm.spec
        for part in path.replace("[", ".").replace("]", "").split("."):
            value = value[int(part)] if part.isdigit() else getattr(value, part)
        values.append(factor * value)
        spec = with_number(spec, path, values[-1])
    return np.array(values), fa.Arm(spec)


def arguments(arm: fa.Arm, seed: int) -> dict[str, np.ndarray]:
    """Return a random state of the arm, with torques and a tip force."""
    rng = np.random.default_rng(seed)
    q, qd, qdd = rng.normal(size=(3, arm.dof)) * [[0.001], [0.5], [2.0]]
    q[arm.joint_index] = rng.uniform(-1.0, 1.0, arm.n_joints)
    torque, force = rng.normal(size=arm.n_joints), rng.normal(size=3)
    return {"q": q, "qd": qd, "qdd": qdd, "torque": torque, "tip_force": force}


def of_busy(b: Busy) -> dict[str, np.ndarray]:
    """Return the same arguments for a random arm."""
    qdd = np.random.default_rng(1).normal(size=b.arm.dof) * 3.0
    return {"q": b.q, "qd": b.qd, "qdd": qdd, "torque": b.torque, "tip_force": b.tip_force}


def expected(
    arm: fa.Arm, q: Any, qd: Any, qdd: Any, torque: Any, tip_force: Any
) -> dict[str, np.ndarray]:
    """Return the results of the arm's methods."""
    force = arm.inverse_dynamics(q, qd, qdd, tip_force)
    residual = force.copy()
    residual[arm.joint_index] -= torque
    return {
        "forward_dynamics": arm.forward_dynamics(q, qd, torque, tip_force),
        "residual": residual,
        "inverse_dynamics": force,
        "bias_force": arm.bias_force(q, qd),
        "mass_matrix": arm.mass_matrix(q),
        "energy": np.array(arm.energy(q, qd)[:3]),
        "tip": arm.tip(q),
        "tip_velocity": arm.tip_velocity(q, qd),
        "strain": arm.strain(q),
        "joint_reactions": arm.joint_reactions(q, qd, qdd, tip_force),
    }


def assert_same(name: str, found: Any, wanted: np.ndarray, arm: fa.Arm, q: Any) -> None:
    """Compare within 1e-12 of the largest number, or within the rounding error of the mass
    matrix."""
    limit = 1e-12
    if name == "forward_dynamics":
        # Accelerations are scaled as in the kinetic energy, so that metres and radians have equal
        # weight. On an ill-conditioned arm, fused multiply-adds of the machine code change further
        # digits.
        M = arm.mass_matrix(q)
        scale = np.sqrt(np.diag(M))
        limit = max(limit, 2.0 * np.finfo(float).eps * np.linalg.cond(M / np.outer(scale, scale)))
        found, wanted = scale * found, scale * wanted
    np.testing.assert_allclose(
        found, wanted, rtol=0, atol=limit * np.abs(wanted).max(initial=0.0), err_msg=name
    )
