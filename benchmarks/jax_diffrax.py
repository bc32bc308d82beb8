"""The paper's own model in JAX, compiled by XLA; fixed steps, or steps chosen by Diffrax."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from peers.arms import TORQUE_ENDS, Case, steps_per_sample

import flexarm as fa
from flexarm.kernels.articulated_body import forward_dynamics
from flexarm.kernels.cache import undecorated
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes

jax.config.update("jax_enable_x64", True)


class _Scalar:
    """A number of JAX that NumPy takes for a number, in an array of objects."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def sin(self) -> _Scalar:
        return _Scalar(jnp.sin(self.value))

    def cos(self) -> _Scalar:
        return _Scalar(jnp.cos(self.value))

    def __neg__(self) -> _Scalar:
        return _Scalar(-self.value)

    def __add__(self, other: Any) -> _Scalar:
        return _Scalar(self.value + _value(other))

    def __sub__(self, other: Any) -> _Scalar:
        return _Scalar(self.value - _value(other))

    def __rsub__(self, other: Any) -> _Scalar:
        return _Scalar(_value(other) - self.value)

    def __mul__(self, other: Any) -> _Scalar:
        return _Scalar(self.value * _value(other))

    def __truediv__(self, other: Any) -> _Scalar:
        return _Scalar(self.value / _value(other))

    def __rtruediv__(self, other: Any) -> _Scalar:
        return _Scalar(_value(other) / self.value)

    __radd__ = __add__
    __rmul__ = __mul__


def _value(number: Any) -> Any:
    return number.value if isinstance(number, _Scalar) else number


def prepare(
    case: Case, arm: fa.Arm, step: float | None = None, rtol: float | None = None
) -> Callable[[], np.ndarray]:
    """Return what gives the states (samples, 2 dof), compiled at the first call with such a case.

    The equations are those of ``arm``, written by our kernels over JAX's numbers: what XLA makes
    of them is one loop without calls. The classical method of Runge and Kutta with steps of
    ``step`` s, or that of Dormand and Prince of order 8 in Diffrax with relative tolerance
    ``rtol``.
    """
    start = jnp.concatenate([arm.rest(case.joint_angles), np.zeros(arm.dof)])
    solve = _compiled(case, arm, step, rtol)
    return lambda: np.asarray(solve(start))


@cache
def _compiled(
    case: Case, arm: fa.Arm, step: float | None, rtol: float | None
) -> Callable[[jax.Array], jax.Array]:
    rates = _rates(case, arm)
    solve = _diffrax(case, rates, rtol) if step is None else _runge_kutta(case, rates, step)
    return jax.jit(solve).lower(jnp.zeros(2 * arm.dof)).compile()


def _rates(case: Case, arm: fa.Arm) -> Callable[..., jax.Array]:
    """Return the derivative of y = (q, qd) as a function that JAX can trace."""
    constants = arm.assembly.constants
    accelerate = undecorated(forward_dynamics)
    sizes, loads = run_time_sizes(constants), no_loads(constants)

    def rates(t: jax.Array, y: jax.Array, _: None = None) -> jax.Array:
        wave = jnp.where(t <= TORQUE_ENDS, jnp.sin(2.0 * np.pi * t), 0.0)
        q, qd = _entries(list(y)).reshape(2, arm.dof)
        state = np.stack([arm.padded(q), arm.padded(qd)])
        drive = arm.padded_torque(_entries([value * wave for value in case.amplitude]))
        work = new_workspace(constants, object)
        accelerate(sizes, constants, state, drive, loads, work)
        return jnp.stack([_value(entry) for entry in [*qd, *arm.unpadded(work.acceleration)]])

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
            # The adjoint methods keep what a gradient needs; this one keeps nothing.
            adjoint=diffrax.ForwardMode(),
        )
        return solution.ys

    return solve


def _entries(scalars: list[jax.Array]) -> np.ndarray:
    array = np.empty(len(scalars), dtype=object)
    array[:] = [_Scalar(scalar) for scalar in scalars]
    return array
