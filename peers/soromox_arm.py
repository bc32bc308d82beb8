"""A case in SoRoMoX: segments of constant curvature, in JAX."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
from diffrax import PIDController, Tsit5
from soromox.systems.components import LinkSpec
from soromox.systems.pcs import PlanarPCS
from soromox.systems.pcs.structures import PlanarPCSStructure
from soromox.systems.system_state import SystemState

from peers.arms import TORQUE_ENDS, Case

jax.config.update("jax_enable_x64", True)

#: Radius of the sections, m: they resist rotation by radius^2 / 4 of the mass, which is negligible.
_RADIUS = 1e-3
#: Length of the segments that represent the joints, m.
_JOINT = 1e-6
#: First step of the integrator, s; the others follow from its error.
_FIRST_STEP = 1e-4


def tip(case: Case, segments: int, rtol: float) -> np.ndarray:
    """Return the path of the tip (samples, 2), m; see ``prepare``."""
    return prepare(case, segments, rtol)()


def prepare(case: Case, segments: int, rtol: float) -> Callable[[], np.ndarray]:
    """Return a function that integrates the model and returns the path of the tip (samples, 2), m.

    Each link has ``segments`` of constant curvature; stretch and shear are excluded. The error
    decreases with the length of the segments. The planar model has no joints: a segment of
    ``_JOINT`` m without stiffness represents each of them, and its coordinate is the angle of the
    joint. SoRoMoX integrates with Diffrax, here by the method of Tsitouras of order 5 with relative
    tolerance ``rtol``. Its actuation is constant in a run, so the torques over time act as a model
    of the environment.

    The first call with given arguments compiles the model. The function raises ``RuntimeError`` if
    the path is not finite.
    """
    solve, start = _compiled(case, segments, rtol)

    def run() -> np.ndarray:
        path = np.asarray(solve(start))
        if not np.isfinite(path).all():
            raise RuntimeError(f"SoRoMoX became unstable with {segments} segments.")
        return path

    return run


@cache
def _compiled(
    case: Case, segments: int, rtol: float
) -> tuple[Callable[[jax.Array], jax.Array], jax.Array]:
    """Return the compiled integration and the initial state."""
    robot = _robot(case, segments)
    joints = np.arange(len(case.lengths)) * (segments + 1)
    count = len(case.lengths) * (segments + 1)
    torques = jnp.zeros(count).at[joints].set(jnp.array(case.amplitude))
    start = jnp.zeros(2 * count).at[joints].set(jnp.array(case.joint_angles))
    times = jnp.arange(case.samples) / case.rate

    def drive(state: SystemState) -> tuple[jax.Array, None]:
        wave = jnp.where(state.t <= TORQUE_ENDS, jnp.sin(2.0 * np.pi * state.t), 0.0)
        return wave * torques, None

    def solve(start: jax.Array) -> jax.Array:
        states = robot.rollout_to(
            SystemState(t=jnp.zeros(()), y=start),
            environment_model=drive,
            t1=times[-1],
            solver_dt=_FIRST_STEP,
            save_ts=times,
            solver=Tsit5(),
            stepsize_controller=PIDController(rtol=rtol, atol=1e-2 * rtol),
        )
        poses = jax.vmap(robot.forward_kinematics_tips)(states.y[:, :count])
        return poses[:, -1, 1:]

    return jax.jit(solve).lower(start).compile(), start


def _robot(case: Case, segments: int) -> PlanarPCS:
    """Return the chain: before each link its joint, then its segments."""
    links: list[LinkSpec] = []
    for length in case.lengths:
        links += [_segment(case, _JOINT, 0.0)]
        links += [_segment(case, length / segments, case.flexural_rigidity)] * segments
    selected = jnp.tile(jnp.array([True, False, False]), len(links))
    layout = PlanarPCSStructure(strain_selector=selected, scale_rotational_basis_by_length=True)
    gravity = jnp.array([0.0, -case.gravity])
    return PlanarPCS.from_links(links, structure=layout, gravity=gravity, base_pose=jnp.zeros(3))


def _segment(case: Case, length: float, rigidity: float) -> LinkSpec:
    """Return a segment; its generalised stiffness is the integral of E I over its length."""
    return LinkSpec.circular(
        length=length,
        radius=_RADIUS,
        density=case.mass_per_length / (np.pi * _RADIUS**2),
        reference_strain=jnp.array([0.0, 1.0, 0.0]),
        stiffness=length * jnp.diag(jnp.array([rigidity, 1.0, 1.0])),
    )
