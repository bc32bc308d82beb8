"""Functions of an arm for C: dynamics, kinematics, and a step of fixed length with derivatives.

A `NamedFunction` has the names and sizes of its arguments in C. The step is that of the classical
Runge-Kutta method of order 4. For real time it has the right properties: its cost does not depend
on the state, it does not iterate, and it is smooth, so that its derivative is exact. The
coefficients are those of the integrator ``rk4``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

import casadi

from flexarm.bridges.symbolic.models import CasadiModel
from flexarm.integrate.explicit_runge_kutta.rk4 import RungeKutta4


@dataclass(frozen=True, eq=False)
class NamedFunction:
    """Function of the exported code."""

    name: str  # in C, without the prefix of the arm
    summary: str  # first sentence of its comment
    #: With dense outputs. Matrices are transposed, because C stores rows.
    function: casadi.Function

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs; those of size zero do not exist in C."""
        sizes = [self.function.numel_in(k) for k in range(self.function.n_in())]
        return [name for name, size in zip(self.function.name_in(), sizes, strict=True) if size]

    @property
    def memory(self) -> str | None:
        """Name of the array that the caller keeps between samples, or None."""
        names = [name for name in self.function.name_out() if name.endswith("memory_out")]
        return names[0].removesuffix("_out") if names else None

    @property
    def given(self) -> list[str]:
        """Names of the inputs without the memory, which is among the results."""
        return [name for name in self.inputs if name != self.memory]

    @property
    def operations(self) -> int | None:
        """Number of elementary operations; None if it calls other functions."""
        function = self.function
        return function.n_instructions() if function.is_a("SXFunction") else None


def named(
    name: str, summary: str, inputs: Mapping[str, Any], outputs: Mapping[str, Any]
) -> NamedFunction:
    """Return a function of symbols."""
    dense = [casadi.densify(value.T) for value in outputs.values()]
    function = casadi.Function(name, list(inputs.values()), dense, list(inputs), list(outputs))
    return NamedFunction(name, summary, function)


#: Output and summary of the functions of `CasadiModel`.
_FUNCTIONS = {
    "forward_dynamics": ("qdd", "Accelerations under joint torques and a force on the tip."),
    "inverse_dynamics": ("force", "Generalised force of a motion: M qdd + bias."),
    "bias_force": ("bias", "Generalised force at zero acceleration, with gravity and stiffness."),
    "mass_matrix": ("mass", "Mass matrix of the kinetic energy 1/2 qd' M qd."),
    "energy": ("energy", "Kinetic, strain and gravity energy, J."),
    "tip": ("tip", "Position and angle of the last tip: x, y (m), angle (rad)."),
    "tip_velocity": ("tip_velocity", "Rates of x, y (m/s) and of the angle (rad/s) of the tip."),
    "strain": ("strain", "Strain at each gauge."),
}
_STEP_INPUTS = ("q", "qd", "torque", "tip_force", "step", "parameters")


def model_functions(model: CasadiModel) -> list[NamedFunction]:
    """Return all functions of an arm; ``strain`` only if it has gauges."""
    functions = []
    for name, (output, summary) in _FUNCTIONS.items():
        if name != "strain" or model.arm.gauges:
            function = getattr(model, name)
            inputs = {key: _symbol(key, function) for key in function.name_in()}
            values = casadi.vertcat(*function.call(list(inputs.values())))
            functions.append(named(name, summary, inputs, {output: values}))
    q, parameters = _symbol("q", model.tip), _symbol("parameters", model.tip)
    inputs = {"q": q, "parameters": parameters}
    jacobian = casadi.jacobian(model.tip(q, parameters), q)
    summary = "Derivative of the tip by the coordinates: rows x, y, angle."
    functions.append(named("tip_jacobian", summary, inputs, {"jacobian": jacobian}))
    sizes = {name: model.forward_dynamics.size1_in(name) for name in _STEP_INPUTS if name != "step"}
    inputs = {name: casadi.MX.sym(name, sizes.get(name, 1)) for name in _STEP_INPUTS}
    after = runge_kutta(model.forward_dynamics, inputs)
    outputs = dict(zip(("q_next", "qd_next"), after, strict=True))
    summary = "State after a step of the classical Runge-Kutta method, torque and force constant."
    functions.append(named("step", summary, inputs, outputs))
    # A Runge-Kutta method is linear in its stages. Therefore the step of matrices [value,
    # derivatives] is the step itself, over accelerations and their derivatives by CasADi.
    n, m = model.arm.dof, model.arm.n_joints
    of_columns = dynamics_of_columns(model, ("q", "qd", "torque"))
    columns = with_derivatives({name: inputs[name] for name in ("q", "qd", "torque")})
    slopes = casadi.vertcat(*runge_kutta(of_columns, inputs | columns))
    outputs = {"by_state": slopes[:, 1 : 2 * n + 1]}
    if m:
        outputs["by_torque"] = slopes[:, 2 * n + 1 :]
    summary = "Derivatives of a step, exact to rounding."
    return [*functions, named("step_jacobian", summary, inputs, outputs)]


def _symbol(name: str, function: Any) -> Any:
    return casadi.SX.sym(name, function.size1_in(name))


def with_derivatives(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return columns [value, derivatives of the value by all values] by name."""
    ends = [0, *accumulate(value.numel() for value in values.values())]
    unit = casadi.MX(casadi.DM.eye(ends[-1]))
    rows = zip(values.items(), pairwise(ends), strict=True)
    return {name: casadi.horzcat(value, unit[slice(*pair), :]) for (name, value), pair in rows}


def dynamics_of_columns(model: CasadiModel, names: Sequence[str]) -> Callable[..., Any]:
    """Return the forward dynamics over columns [value, derivatives] of the inputs in ``names``."""
    dynamics = model.forward_dynamics
    values = {name: _symbol(name, dynamics) for name in dynamics.name_in()}
    qdd = dynamics(*values.values())
    slopes = [casadi.densify(casadi.jacobian(qdd, values[name])) for name in names]
    of_values = casadi.Function("slopes", list(values.values()), [qdd, *slopes])

    def of_columns(*inputs: Any) -> Any:
        given = dict(zip(values, inputs, strict=True))
        now, *by = of_values(*(one[:, 0] for one in inputs))
        moved = zip(by, names, strict=True)
        return casadi.horzcat(now, sum(slope @ given[name][:, 1:] for slope, name in moved))

    return of_columns


def runge_kutta(dynamics: Any, inputs: Mapping[str, Any]) -> tuple[Any, Any]:
    """Return q and qd after one step; they have columns that are stepped together."""
    q, qd, h = inputs["q"], inputs["qd"], inputs["step"]
    others = [inputs[name] for name in ("torque", "tip_force", "parameters")]
    tableau = RungeKutta4().tableau
    rates: list[tuple[Any, Any]] = []
    for row in (*tableau.A[: tableau.stages], tableau.b):
        at, rate = q, qd
        for weight, (velocity, acceleration) in zip(row, rates, strict=False):
            if weight != 0.0:
                at = at + (h * weight) * velocity
                rate = rate + (h * weight) * acceleration
        rates.append((rate, dynamics(at, rate, *others) if len(rates) < tableau.stages else None))
        state = at, rate
    return state
