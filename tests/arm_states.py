"""Random arms with a state, in the package's coordinates, and helpers for them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh

import flexarm as fa
from flexarm.arm.actions import place_loads, tip_load
from flexarm.kernels.layout import (
    ArmConstants,
    Loads,
    Workspace,
    new_workspace,
    run_time_sizes,
)
from flexarm.kernels.observation.observables import POSE_COLUMNS, energies
from flexarm.kernels.recursion.composite_body import mass_matrix
from random_arms import NodalState, random_spec, random_state

#: Perturbation along the imaginary axis, so that derivatives are exact to rounding.
IMAGINARY = 1e-30


@dataclass(frozen=True)
class Drawn:
    """Random arm in a random state: q, qd, qdd (dof,), torque (joints,), and a force (3,) on its
    tip."""

    arm: fa.Arm
    state: NodalState
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    torque: np.ndarray
    tip_force: np.ndarray


def drawn(seed: int, **wishes: Any) -> Drawn:
    """Draw an arm and a state; keyword arguments are those of ``random_spec``."""
    rng = np.random.default_rng(seed)
    spec = random_spec(rng, **wishes)
    arm = fa.Arm(spec)
    state = random_state(rng, spec)
    return Drawn(
        arm=arm,
        state=state,
        q=arm.from_nodal(state.angles, free_nodes(arm, state.nodal)),
        qd=arm.from_nodal(state.angle_rates, free_nodes(arm, state.nodal_rates)),
        # Radians per second squared, and modal accelerations of the same size.
        qdd=rng.normal(size=arm.dof) * 3.0,
        torque=rng.normal(size=arm.n_joints) * 5.0,
        tip_force=rng.normal(size=3) * [3.0, 3.0, 1.0],
    )


def free_nodes(arm: fa.Arm, nodal: list[np.ndarray]) -> list[np.ndarray]:
    """Return the nodal values, with zeros in place of the empty arrays of rigid links."""
    return [
        values if values.size else np.zeros((link.elements, 2))
        for values, link in zip(nodal, arm.spec.links, strict=True)
    ]


def changed(arm: fa.Arm, **fields: Any) -> fa.Arm:
    """Return the arm with some fields of its specification replaced."""
    return fa.Arm(arm.spec.model_copy(update=fields))


def state_array(arm: fa.Arm, q: Any, qd: Any) -> np.ndarray:
    """Return the kernels' state (2, n, 1 + m) of real or complex coordinates and rates."""
    return arm.padded(np.stack([np.asarray(q), np.asarray(qd)]))


def parts(arm: fa.Arm, dtype: Any = float) -> tuple[Any, ArmConstants, Workspace]:
    """Return sizes, constants and a new workspace, the first arguments of kernels."""
    constants = arm.assembly.constants
    return run_time_sizes(constants), constants, new_workspace(constants, dtype)


def tip_loads(arm: fa.Arm, force: Any = (0.0, 0.0, 0.0)) -> Loads:
    """Return the kernels' loads for a force (Fx, Fy, Mz) of any number type on the last tip."""
    placed = place_loads(arm, tip_load(arm, np.ones(3)))
    return placed._replace(value=np.asarray(force)[None])


def modal_parts(arm: fa.Arm) -> np.ndarray:
    """Return a mask (dof,) that is true for elastic coordinates."""
    elastic = np.ones(arm.dof, dtype=bool)
    elastic[arm.joint_index] = False
    return elastic


def squared_frequencies(arm: fa.Arm, angles: Any, locked: list[int]) -> np.ndarray:
    """Return squared frequencies (rad^2/s^2), ascending, of straight links with some joints
    locked."""
    q = arm.rest(angles)
    kept = np.setdiff1d(np.arange(arm.dof), arm.joint_index[locked])
    part = np.ix_(kept, kept)
    if kept.size == 0:  # `eigh` of older versions of SciPy fails here
        return np.zeros(0)
    M, K = arm.mass_matrix(q)[part], arm.stiffness_matrix(q)[part]
    # The lowest frequencies are the largest eigenvalues of the inverse problem, which are accurate.
    inverse = eigh(M, K + M, eigvals_only=True)[::-1]
    return 1.0 / inverse - 1.0


def exact_derivative(function: Any, point: np.ndarray, direction: np.ndarray) -> Any:
    """Return the directional derivative of a function of complex arrays, without cancellation."""
    return function(point + 1j * IMAGINARY * direction).imag / IMAGINARY


def complex_energies(arm: fa.Arm, state: np.ndarray) -> np.ndarray:
    """Return kinetic, strain and gravity energy (3,) of a complex state (2, dof)."""
    sizes, constants, _ = parts(arm)
    n = arm.assembly.bodies
    poses, tip = np.zeros((n, POSE_COLUMNS), complex), np.zeros(6, complex)
    energy = np.zeros(3, complex)
    energies(sizes, constants, state_array(arm, *state).astype(complex), poses, tip, energy)
    return energy


def complex_mass_matrix(arm: fa.Arm, q: np.ndarray) -> np.ndarray:
    """Return the mass matrix (dof, dof) at complex coordinates."""
    sizes, constants, work = parts(arm, complex)
    n, width = arm.assembly.bodies, 1 + arm.assembly.modes
    M = np.zeros((n, width, n, width), complex)
    mass_matrix(sizes, constants, state_array(arm, q, 0.0 * q).astype(complex), work, M)
    kept = arm.assembly.coordinates
    return M.reshape(n * width, n * width)[np.ix_(kept, kept)]
