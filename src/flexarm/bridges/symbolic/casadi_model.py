"""Equations of motion of an arm as CasADi functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_kind, library_missing
from flexarm.base.errors import public_call
from flexarm.bridges.symbolic.kernel_calls import ParametricArm, objects, plain
from flexarm.linear.statics.gaps import warn_of_creep

if TYPE_CHECKING:
    import casadi


@dataclass(frozen=True, eq=False)
class CasadiModel:
    """Equations of one arm as ``casadi.Function`` objects with named inputs and outputs.

    Every function ends with the input ``parameters``, of size 0 if the model has none. In a call
    by name, missing inputs are NaN, except ``tip_force``, which is zero. World axes; SI units.

    ==============  ======================  =====================================================
    input           size                    meaning
    ==============  ======================  =====================================================
    ``q``           dof                     coordinates: rad, m sqrt(kg)
    ``qd``          dof                     their rates
    ``qdd``         dof                     their accelerations
    ``torque``      joints                  N m; rad/s^2 of a prescribed joint
    ``tip_force``   3                       Fx, Fy (N) and Mz (N m) on the last tip
    ``parameters``  number of parameters    in the units of the file
    ==============  ======================  =====================================================

    Attributes:
        arm: the arm.
        parameters: paths of the parameters.
        nominal: their values in the arm.
        forward_dynamics: (q, qd, torque, tip_force, parameters) -> qdd.
        residual: (q, qd, qdd, torque, tip_force, parameters) -> residual (dof,), zero on a motion:
            M qdd + bias - torque; N m in the rows of joints.
        inverse_dynamics: (q, qd, qdd, tip_force, parameters) -> force (dof,), M qdd + bias.
        bias_force: (q, qd, parameters) -> bias (dof,), with gravity and stiffness.
        mass_matrix: (q, parameters) -> M (dof, dof).
        energy: (q, qd, parameters) -> kinetic, strain, gravity (J).
        tip: (q, parameters) -> tip (3,): x, y (m), angle (rad).
        tip_velocity: (q, qd, parameters) -> tip_velocity (3,), the rates of ``tip``.
        strain: (q, parameters) -> strain (gauges,).
        joint_reactions: (q, qd, qdd, tip_force, parameters) -> reactions (links, 3): force and
            moment on each link from the joint at its root, Fx, Fy (N), Mz (N m).
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
    return exported_model(arm, parameters, prescribed)


def exported_model(
    arm: Arm, parameters: Sequence[str], prescribed: Sequence[int] = ()
) -> CasadiModel:
    """Return the model of `to_casadi`, with its warnings, for exports, which errors then name."""
    model = casadi_model(arm, parameters, prescribed)
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
    check_kind("arm", arm, Arm)
    parametric = ParametricArm(arm, parameters, prescribed)
    sizes = {"q": arm.dof, "qd": arm.dof, "qdd": arm.dof, "torque": arm.joints, "tip_force": 3}
    sizes["parameters"] = len(parametric.paths)
    symbols = {name: casadi.SX.sym(name, size) for name, size in sizes.items()}
    entries = {
        name: objects(casadi.vertsplit(symbol) if symbol.numel() else [], casadi)
        for name, symbol in symbols.items()
    }
    calls, functions = parametric.at(list(entries["parameters"])), {}
    for name, (inputs, outputs) in _FUNCTIONS.items():
        values = getattr(calls, name)(*(entries[one] for one in inputs))
        names = [*inputs, "parameters"]
        # By default CasADi uses zero for a missing input, which is silently a wrong state.
        default = [0.0 if one == "tip_force" else math.nan for one in names]
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


_STATE, _MOTION = ("q", "qd"), ("q", "qd", "qdd")
#: Inputs without the parameters, and outputs, of each function.
_FUNCTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "forward_dynamics": ((*_STATE, "torque", "tip_force"), ("qdd",)),
    "residual": ((*_MOTION, "torque", "tip_force"), ("residual",)),
    "inverse_dynamics": ((*_MOTION, "tip_force"), ("force",)),
    "bias_force": (_STATE, ("bias",)),
    "mass_matrix": (("q",), ("M",)),
    "energy": (_STATE, ("kinetic", "strain", "gravity")),
    "tip": (("q",), ("tip",)),
    "tip_velocity": (_STATE, ("tip_velocity",)),
    "strain": (("q",), ("strain",)),
    "joint_reactions": ((*_MOTION, "tip_force"), ("reactions",)),
}
