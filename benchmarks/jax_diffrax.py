"""The paper's model in JAX, compiled by XLA; fixed steps, or step control by Diffrax."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from peers.arms import TORQUE_ENDS, Case, steps_per_sample

import flexarm as fa

jax.config.update("jax_enable_x64", True)


def prepare(
    case: Case, arm: fa.Arm, step: float | None = None, rtol: float | None = None
) -> Callable[[], np.ndarray]:
    """Return a function that computes the states (samples, 2 dof).

    The first call with given arguments compiles it. The equations are those of ``arm``, from
    ``flexarm.to_jax``; XLA compiles them to one loop without calls. The method is the
    classical one of Runge and Kutta with steps of ``step`` s, or that of Dormand and Prince of
    order 8 in Diffrax with relative tolerance ``rtol``.
    """
    start = jnp.concatenate([arm.rest(case.joint_angles), np.zeros(arm.dof)])
    solve = _compiled(case, arm, step, rtol)
    return lambda: np.asarray(solve(start))


def many(case: Case, arm: fa.Arm, step: float, angles: np.ndarray) -> np.ndarray:
    """Return the states (runs, samples, 2 dof) from joint angles (runs, joints) by ``jax.vmap``."""
    starts = np.zeros((len(angles), 2 * arm.dof))
    starts[:, : arm.dof] = [arm.rest(one) for one in angles]
    return np.asarray(_compiled_many(case, arm, step, len(angles))(starts))


@cache
def _compiled_many(
    case: Case, arm: fa.Arm, step: float, count: int
) -> Callable[[jax.Array], jax.Array]:
    solve = jax.vmap(_runge_kutta(case, _rates(case, arm), step))
    return jax.jit(solve).lower(jnp.zeros((count, 2 * arm.dof))).compile()


@cache
def _compiled(
    case: Case, arm: fa.Arm, step: float | None, rtol: float | None
) -> Callable[[jax.Array], jax.Array]:
    rates = _rates(case, arm)
    solve = _diffrax(case, rates, rtol) if step is None else _runge_kutta(case, rates, step)
    return jax.jit(solve).lower(jnp.zeros(2 * arm.dof)).compile()


def _rates(case: Case, arm: fa.Arm) -> Callable[..., jax.Array]:
    """Return the derivative of y = (q, qd) as a function that JAX can trace."""
    accelerate = fa.to_jax(arm).forward_dynamics
    amplitude = jnp.array(case.amplitude)

    def rates(t: jax.Array, y: jax.Array, _: None = None) -> jax.Array:
        wave = jnp.where(t <= TORQUE_ENDS, jnp.sin(2.0 * np.pi * t), 0.0)
        q, qd = y[: arm.dof], y[arm.dof :]
        return jnp.concatenate([qd, accelerate(q, qd, wave * amplitude)])

    return rates


def _runge_kutta(
    case: Case, rates: Callable[..., jax.Array], step: float
) -> Callable[[jax.Array], jax.Array]:
    count = steps_per_sample(case, step)

    def advance(t: jax.Array, y: jax.Array) -> jax.Array:
        k1 = rates(t, y)
        k2 = rates(t + 0.5 * step, y + 0.5 * step * k1)
        k3 = rates(t + 0.5 * step, y + 0.5 * step * k2)
        k4 = rates(t + step, y + step * k3)
        return y + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    def to_next_sample(y: jax.Array, sample: jax.Array) -> tuple[jax.Array, jax.Array]:
        def step_number(number: int, y: jax.Array) -> jax.Array:
            return advance((sample * count + number) * step, y)

        y = jax.lax.fori_loop(0, count, step_number, y)
        return y, y

    def solve(start: jax.Array) -> jax.Array:
        _, states = jax.lax.scan(to_next_sample, start, jnp.arange(case.samples - 1))
        return jnp.concatenate([start[None], states])

    return solve


def _diffrax(
    case: Case, rates: Callable[..., jax.Array], rtol: float
) -> Callable[[jax.Array], jax.Array]:
    samples = jnp.arange(case.samples) / case.rate
    controller = diffrax.PIDController(rtol=rtol, atol=1e-2 * rtol)

    def solve(start: jax.Array) -> jax.Array:
        solution = diffrax.diffeqsolve(
            diffrax.ODETerm(rates),
            diffrax.Dopri8(),
            0.0,
            case.duration,
            1e-4,
            start,
            saveat=diffrax.SaveAt(ts=samples),
            stepsize_controller=controller,
            max_steps=1_000_000,
            # Adjoint methods store data for a gradient; this one stores nothing.
            adjoint=diffrax.ForwardMode(),
        )
        return solution.ys

    return solve
