"""CasADi and JAX models of mechanisms, against the methods of the arm."""

from __future__ import annotations

import numpy as np
import pytest

import flexarm as fa
from closed_mechanisms import cooperating_arms, four_bar

LINK = fa.Link(length=0.5, mass_per_length=1.0, flexural_rigidity=50.0, elements=1, modes=1)
#: On the root of the first link, on its tip, and a base in motion below them.
FORK = {"links": [LINK, LINK, LINK.replace(parent=1)]}
TREES = {
    "branches": fa.Arm(**FORK),
    "base": fa.Arm(**FORK, base=fa.Base(mass=1.0, inertia=0.3, free=("x", "angle"))),
}


def flat(value) -> np.ndarray:
    """Return a result of CasADi as a vector."""
    return value.full().ravel()


@pytest.mark.parametrize("name", TREES)
def test_reactions_of_branches_turn_with_their_parents(name: str) -> None:
    arm = TREES[name]
    rng = np.random.default_rng(0)
    q, qd, qdd = rng.standard_normal((3, arm.dof))
    exact = arm.joint_reactions(q, qd, qdd)
    found = fa.to_casadi(arm).joint_reactions(q, qd, qdd, np.zeros(3), []).full()
    # Sums in another order.
    np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-12 * np.abs(exact).max())


@pytest.mark.parametrize("mechanism", [four_bar(), cooperating_arms()], ids=["four-bar", "arms"])
def test_models_of_closed_mechanisms(mechanism) -> None:
    arm = fa.Arm(**mechanism.fields)
    first = fa.assembled(arm, arm.rest(mechanism.joints), arm.rest(np.ones(arm.n_joints)))
    torque = np.linspace(0.2, 0.4, arm.n_joints)
    run = fa.simulate(
        arm, 0.05, torque=lambda t: torque, initial=first.q, initial_rate=first.qd
    ).isel(time=-1)
    q, qd = run.q.values, run.qd.values
    qdd, forces = arm.forward_dynamics(q, qd, torque), arm.closure_forces(q, qd, torque)
    model = fa.to_casadi(arm)
    none = np.zeros(3)
    tight = {"rtol": 0.0, "atol": 1e-11 * np.abs(qdd).max()}
    np.testing.assert_allclose(flat(model.forward_dynamics(q, qd, torque, none, [])), qdd, **tight)
    tight["atol"] = 1e-10 * np.abs(forces).max()
    np.testing.assert_allclose(flat(model.closure_forces(q, qd, torque, none, [])), forces, **tight)
    residual = flat(model.residual(q, qd, qdd, torque, none, forces, []))
    # Rounding of accelerations, whose mass matrix has a condition of 1e5.
    np.testing.assert_allclose(residual, 0.0, atol=1e-8 * np.abs(forces).max())
    reactions = arm.joint_reactions(q, qd, qdd, closure_forces=forces)
    np.testing.assert_allclose(
        model.joint_reactions(q, qd, qdd, none, forces, []).full(), reactions, **tight
    )
    moved = q + 1e-3
    np.testing.assert_allclose(
        flat(model.closure_gaps(moved, [])), arm.closure_gaps(moved), rtol=0.0, atol=1e-14
    )
