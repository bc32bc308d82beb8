"""Equations of motion of an arm as CasADi functions and as JAX functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm, Energy
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_kind, library_missing
from flexarm.base.errors import InputError, Problem, public_call, shown
from flexarm.bridges.symbolic.kernel_calls import ParametricArm, objects, plain
from flexarm.linear.statics.gaps import warn_of_creep
from flexarm.model.arm.spec import serial_only

if TYPE_CHECKING:
    import casadi
    from jax import Array
    from jax.typing import ArrayLike


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """Equations of one arm as ``casadi.Function`` objects with named inputs and outputs.

    Every function ends with the input ``parameters``, of size 0 if the model has none. In a call
    by name, missing inputs are NaN, except forces, which are zero. World axes; SI units.

    ==================  ====================  =================================================
    input               size                  meaning
    ==================  ====================  =================================================
    ``q``               dof                   coordinates: rad, m sqrt(kg)
    ``qd``              dof                   their rates
    ``qdd``             dof                   their accelerations
    ``torque``          joints                N m; rad/s^2 of a prescribed joint
    ``tip_force``       3                     Fx, Fy (N) and Mz (N m) on the last tip
    ``closure_forces``  closure_rows          N and N m; only of an arm with closures
    ``parameters``      number of parameters  in the units of the file
    ==================  ====================  =================================================

    Attributes:
        arm: the arm.
        parameters: paths of the parameters.
        nominal: their values in the arm.
        forward_dynamics: (q, qd, torque, tip_force, parameters) -> qdd.
        residual: (q, qd, qdd, torque, tip_force, closure_forces, parameters) -> residual (dof,),
            zero on a motion: M qdd + bias - torque - J' closure_forces; N m in the rows of joints.
        inverse_dynamics: (q, qd, qdd, tip_force, closure_forces, parameters) -> force (dof,),
            M qdd + bias - J' closure_forces.
        bias_force: (q, qd, parameters) -> bias (dof,), with gravity and stiffness.
        mass_matrix: (q, parameters) -> M (dof, dof).
        energy: (q, qd, parameters) -> kinetic, strain, gravity (J).
        tip: (q, parameters) -> tip (3,): x, y (m), angle (rad).
        tip_velocity: (q, qd, parameters) -> tip_velocity (3,), the rates of ``tip``.
        strain: (q, parameters) -> strain (gauges,).
        joint_reactions: (q, qd, qdd, tip_force, closure_forces, parameters) -> reactions (links,
            3): force and moment on each link from the joint at its root, Fx, Fy (N), Mz (N m).
        closure_gaps: (q, parameters) -> gaps (closure_rows,), as `Arm.closure_gaps`.
        closure_forces: (q, qd, torque, tip_force, parameters) -> closure_forces (closure_rows,).
    """

    arm: Arm
    parameters: tuple[str, ...]
    nominal: FloatArray
    forward_dynamics: casadi.Function
    residual: casadi.Function
    inverse_dynamics: casadi.Function
    bias_force: casadi.Function
    mass_matrix: casadi.Function
    energy: casadi.Function
    tip: casadi.Function
    tip_velocity: casadi.Function
    strain: casadi.Function
    joint_reactions: casadi.Function
    closure_gaps: casadi.Function
    closure_forces: casadi.Function


@public_call
def to_casadi(
    arm: Arm, parameters: Sequence[str] = (), prescribed: Sequence[int] = ()
) -> CasadiModel:
    """Convert the equations of an arm to CasADi functions.

    The functions result from the source of the kernels, evaluated over CasADi scalars. They equal
    the arm's methods to rounding, for every option of joints and links. Contacts are not included.

    Args:
        arm: the arm.
        parameters: paths of numbers that become inputs: ``payload.mass``,
            ``joints[1].friction.coulomb``, ``links[0].flexural_rigidity``. All numbers of joints,
            payload, gravity, gauges and damping are possible; of links, those that scale rigidity,
            mass or length as a whole, which keeps the mode shapes.
        prescribed: numbers of joints with prescribed accelerations: in ``forward_dynamics`` their
            entries of ``torque`` are in rad/s^2.

    Raises:
        InputError: if CasADi is not installed, a path is not that of a number, a number changes the
            mode shapes, or a joint of ``prescribed`` is fixed.

    Warns:
        AccuracyWarning: friction has bristles or holds joints, which the functions do not contain.
    """
    model = casadi_model(arm, parameters, prescribed)
    warn_of_creep(arm, "the exported model")
    return model


def exported_model(arm: Arm, parameters: Sequence[str]) -> CasadiModel:
    """Return the model of `to_casadi`, with its warnings, for exports, which errors then name."""
    check_kind("arm", arm, Arm)
    # An exported step does not keep loops closed.
    serial_only(arm.spec, "an export of the equations", ("closures",))
    model = casadi_model(arm, parameters)
    warn_of_creep(arm, "the exported model")
    return model


def casadi_model(
    arm: Arm, parameters: Sequence[str] = (), prescribed: Sequence[int] = ()
) -> CasadiModel:
    """Return the model of `to_casadi` for computations with the friction of the model."""
    try:
        import casadi
    except ImportError:
        raise library_missing("CasADi", "casadi") from None
    parametric = ParametricArm(arm, parameters, prescribed)
    sizes = {"q": arm.dof, "qd": arm.dof, "qdd": arm.dof, "torque": arm.n_joints, "tip_force": 3}
    sizes |= {"closure_forces": arm.closure_rows, "parameters": len(parametric.paths)}
    symbols = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    entries = {
        name: objects(casadi.vertsplit(symbol) if symbol.numel() else [], casadi)
        for name, symbol in symbols.items()
    }
    calls, functions = parametric.at(list(entries["parameters"])), {}
    for name, (inputs, outputs) in _FUNCTIONS.items():
        kept = [one for one in inputs if one != "closure_forces" or arm.closure_rows]
        values = getattr(calls, name)(*(entries[one] for one in kept))
        names = [*kept, "parameters"]
        # By default CasADi uses zero for a missing input, which is silently a wrong state.
        default = [0.0 if one in _FORCES else math.nan for one in names]
        functions[name] = casadi.Function(
            name,
            [symbols[one] for one in names],
            [_matrix(part) for part in (values if len(outputs) > 1 else [values])],
            names,
            list(outputs),
            {"default_in": default},
        )
    return CasadiModel(parametric.arm, parametric.paths, parametric.nominal, **functions)


def _matrix(values: Any) -> Any:
    """Return a number, a vector or a matrix of objects as one expression."""
    import casadi

    array = np.atleast_1d(np.asarray(values, dtype=object))
    if array.size == 0:  # an arm without gauges
        return casadi.SX(0, 1)
    rows = [[casadi.SX(plain(one)) for one in row] for row in array.reshape(len(array), -1)]
    return casadi.vertcat(*(casadi.horzcat(*row) for row in rows))


_STATE, _MOTION, _FORCES = ("q", "qd"), ("q", "qd", "qdd"), ("tip_force", "closure_forces")
#: Inputs without the parameters, and outputs, of each function.
_FUNCTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "forward_dynamics": ((*_STATE, "torque", "tip_force"), ("qdd",)),
    "residual": ((*_MOTION, "torque", *_FORCES), ("residual",)),
    "inverse_dynamics": ((*_MOTION, *_FORCES), ("force",)),
    "bias_force": (_STATE, ("bias",)),
    "mass_matrix": (("q",), ("M",)),
    "energy": (_STATE, ("kinetic", "strain", "gravity")),
    "tip": (("q",), ("tip",)),
    "tip_velocity": (_STATE, ("tip_velocity",)),
    "strain": (("q",), ("strain",)),
    "joint_reactions": ((*_MOTION, *_FORCES), ("reactions",)),
    "closure_gaps": (("q",), ("gaps",)),
    "closure_forces": ((*_STATE, "torque", "tip_force"), ("closure_forces",)),
}


class JaxModel:
    """Equations of one arm as functions of JAX arrays, compiled by XLA at their first call.

    ``jit``, ``vmap``, ``grad``, ``jvp`` and the other transformations of JAX apply. The results
    have the floating-point type of the arguments: float32, or float64 after
    ``jax.config.update("jax_enable_x64", True)``. World axes; SI units.

    Common arguments of the methods:

    ==============  =============  =============================================================
    argument        shape          meaning
    ==============  =============  =============================================================
    ``q``           (dof,)         coordinates: rad, m sqrt(kg)
    ``qd``          (dof,)         their rates
    ``qdd``         (dof,)         their accelerations
    ``torque``      (joints,)      N m; rad/s^2 of a prescribed joint
    ``tip_force``   (3,)           Fx, Fy (N) and Mz (N m) on the last tip; None for no force
    ``parameters``  (parameters,)  in the units of the file; None for those of the arm
    ==============  =============  =============================================================

    ``closure_forces`` (closure_rows,) of an arm with closures are in N and N m; None for no forces.

    Attributes:
        arm: the arm.
        parameters: paths of the parameters.
        nominal: their values in the arm.

    Raises:
        InputError: in every method, if an argument does not have its shape.
    """

    def __init__(self, parametric: ParametricArm) -> None:
        import jax

        self.arm = parametric.arm
        self.parameters: tuple[str, ...] = parametric.paths
        self.nominal: FloatArray = parametric.nominal
        self._parametric = parametric
        self._run = jax.jit(self._trace, static_argnums=0)
        sizes = {"q": self.arm.dof, "qd": self.arm.dof, "qdd": self.arm.dof}
        sizes |= {"torque": self.arm.n_joints, "tip_force": 3, "parameters": len(self.parameters)}
        sizes["closure_forces"] = self.arm.closure_rows
        self._sizes = sizes

    def forward_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Return the accelerations qdd (dof,) under joint torques."""
        return self._call("forward_dynamics", parameters, q, qd, torque, tip_force)

    def residual(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        closure_forces: ArrayLike | None = None,
    ) -> Array:
        """Return M qdd + bias - torque (dof,): zero on a motion; N m in the rows of joints."""
        forces = torque, tip_force, closure_forces
        return self._call("residual", parameters, q, qd, qdd, *forces)

    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        closure_forces: ArrayLike | None = None,
    ) -> Array:
        """Return the generalised force (dof,) for given accelerations, M qdd + bias."""
        return self._call("inverse_dynamics", parameters, q, qd, qdd, tip_force, closure_forces)

    def bias_force(self, q: ArrayLike, qd: ArrayLike, parameters: ArrayLike | None = None) -> Array:
        """Return the force (dof,) at zero acceleration, with stiffness, damping and gravity."""
        return self._call("bias_force", parameters, q, qd)

    def mass_matrix(self, q: ArrayLike, parameters: ArrayLike | None = None) -> Array:
        """Return M (dof, dof) of the kinetic energy 1/2 qd' M qd."""
        return self._call("mass_matrix", parameters, q)

    def energy(self, q: ArrayLike, qd: ArrayLike, parameters: ArrayLike | None = None) -> Energy:
        """Return kinetic, strain and gravity energy (J), and their ``total``."""
        return Energy(*self._call("energy", parameters, q, qd))

    def tip(self, q: ArrayLike, parameters: ArrayLike | None = None) -> Array:
        """Return x, y (m) and angle (rad) of the last tip, (3,)."""
        return self._call("tip", parameters, q)

    def tip_velocity(
        self, q: ArrayLike, qd: ArrayLike, parameters: ArrayLike | None = None
    ) -> Array:
        """Return the rates of x, y (m/s) and angle (rad/s) of the last tip, (3,)."""
        return self._call("tip_velocity", parameters, q, qd)

    def strain(self, q: ArrayLike, parameters: ArrayLike | None = None) -> Array:
        """Return the strain at each gauge, (gauges,)."""
        return self._call("strain", parameters, q)

    def joint_reactions(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        tip_force: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
        closure_forces: ArrayLike | None = None,
    ) -> Array:
        """Return force and moment on each link at its root: (links, 3), Fx, Fy N, Mz N m."""
        return self._call("joint_reactions", parameters, q, qd, qdd, tip_force, closure_forces)

    def closure_gaps(self, q: ArrayLike, parameters: ArrayLike | None = None) -> Array:
        """Return how far the loops are from closed, (closure_rows,), as `Arm.closure_gaps`."""
        return self._call("closure_gaps", parameters, q)

    def closure_forces(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        torque: ArrayLike,
        tip_force: ArrayLike | None = None,
        parameters: ArrayLike | None = None,
    ) -> Array:
        """Return the forces of closures (closure_rows,) under joint torques, N and N m."""
        return self._call("closure_forces", parameters, q, qd, torque, tip_force)

    def _call(self, name: str, parameters: Any, *values: Any) -> Any:
        """Validate the arguments of a method and evaluate it in their common type."""
        import jax.numpy as jnp

        given = dict(zip(_FUNCTIONS[name][0], values, strict=True))
        given["parameters"] = self.nominal if parameters is None else parameters
        try:
            arrays = {
                argument: self._array(argument, value)
                for argument, value in given.items()
                if not (value is None and argument in _FORCES)
            }
        except InputError as error:
            raise error.at(f"JaxModel.{name}") from None
        # Arguments of NumPy in float64 are converted to the type of the state.
        dtype = jnp.promote_types(arrays["q"].dtype, jnp.float32)
        return self._run(name, {key: array.astype(dtype) for key, array in arrays.items()})

    def _array(self, name: str, value: Any) -> Any:
        import jax.numpy as jnp

        shape = (self._sizes[name],)
        try:
            array = jnp.asarray(value)
        except Exception:  # rows of different lengths, text, objects
            array = None
        if array is None or array.shape != shape or array.dtype.kind not in "iuf":
            given = shown(value) if array is None else f"of shape {array.shape}"
            raise InputError(Problem(name, f"be numbers of shape ({shape[0]},)", given))
        return array

    def _trace(self, name: str, arrays: dict[str, Any]) -> Any:
        """Evaluate a kernel over the scalars of traced arrays."""
        import jax.numpy as jnp

        scalars = {
            key: objects([array[k] for k in range(self._sizes[key])], jnp)
            for key, array in arrays.items()
        }
        calls = self._parametric.at(list(scalars.pop("parameters")))
        values = getattr(calls, name)(**scalars)
        dtype = arrays["q"].dtype
        flat = [jnp.asarray(plain(value), dtype) for value in values.ravel()]
        return jnp.stack(flat).reshape(values.shape) if flat else jnp.zeros(values.shape, dtype)


@public_call
def to_jax(arm: Arm, parameters: Sequence[str] = (), prescribed: Sequence[int] = ()) -> JaxModel:
    """Convert the equations of an arm to JAX functions.

    The functions result from the source of the kernels, evaluated over JAX's traced scalars. They
    equal the arm's methods to rounding, for every option of joints and links. Contacts are not
    included. On a GPU, ``vmap`` evaluates many arms at once.

    Args:
        arm, parameters, prescribed: as in ``to_casadi``.

    Raises:
        InputError: if JAX is not installed, or under the conditions of ``to_casadi``.

    Warns:
        AccuracyWarning: as in ``to_casadi``.
    """
    try:
        import jax  # noqa: F401
    except ImportError:
        raise library_missing("JAX", "jax") from None
    model = JaxModel(ParametricArm(arm, parameters, prescribed))
    warn_of_creep(arm, "the exported model")
    return model
