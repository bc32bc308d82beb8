"""Kernels as plain Python functions over arrays of objects, with parameters of the arm.

The objects are scalars of CasADi or JAX. No other module of the package depends on the layout of
the kernels' arrays. Arguments and results are arrays of objects in the coordinates of the arm: q,
qd, qdd (dof,), torque (joints,), tip_force (3,). Entries are `Scalar` objects or numbers.

Parameters are identified by paths in the file of the arm; the formulas of the constants are those
of `constants_at`. A number of a link that changes the mode shapes has none and is rejected. Each
formula is verified numerically: the parameter is multiplied by four, and the constants from the
formula are compared with those of an arm with the changed number.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextvars import ContextVar
from functools import cache
from operator import eq, ge, gt, le, lt, ne
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions import place_loads, tip_load
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.arm.assembly.coordinates import carriers_of, check_joint
from flexarm.arm.stations import Cut, forces_at, place_gauges
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem
from flexarm.kernels.columns import GAP, MULTIPLIER
from flexarm.kernels.compilation.cache import undecorated
from flexarm.kernels.compilation.numbers import tanh
from flexarm.kernels.controller_terms.tip_motion import tip_motion
from flexarm.kernels.layout import (
    ArmConstants,
    Loads,
    Workspace,
    new_workspace,
    no_loads,
    run_time_sizes,
)
from flexarm.kernels.observation.observables import POSE_COLUMNS, energies, poses
from flexarm.kernels.observation.point_motion import MOTION_COLUMNS, point_motions
from flexarm.kernels.observation.section_forces import section_forces
from flexarm.kernels.observation.shapes import gauge_strains
from flexarm.kernels.recursion.articulated_body import forward_dynamics
from flexarm.kernels.recursion.closures import closure_gaps
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics
from flexarm.linear.statics.gaps import warn_of_bristles
from flexarm.linear.step_derivatives.parameters import check_closed_form, constants_at
from flexarm.model.paths import number_at

#: Array of objects: `Scalar` objects and numbers.
Objects = NDArray[Any]


def _of_numbers(method: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """Delegate operations with arrays to NumPy, which applies them to each entry."""

    def operation(self: Any, other: Any) -> Any:
        return NotImplemented if isinstance(other, np.ndarray) else method(self, other)

    return operation


class SymbolError(TypeError):
    """Error of code that cannot be evaluated over symbols."""


#: Function that chooses the truth value of a symbol, while code with conditions is evaluated.
choose: ContextVar[Callable[[Any], bool] | None] = ContextVar("choose", default=None)


class Scalar:
    """Scalar of CasADi or JAX as an entry of an array of objects.

    The wrapper is necessary because NumPy treats the libraries' own scalars as arrays. Sums with 0
    and products with 0 and 1, which are frequent in padded modes, are simplified. The library is
    the module with the functions of the scalar, ``casadi`` or ``jax.numpy``.
    """

    __slots__ = ("library", "value")
    symbolic: ClassVar[bool] = True

    def __init__(self, value: Any, library: Any) -> None:
        self.value = value
        self.library = library

    def __deepcopy__(self, memo: dict[int, Any]) -> Scalar:
        return self  # it does not change, and modules cannot be copied

    def _new(self, value: Any) -> Scalar:
        return Scalar(value, self.library)

    def __neg__(self) -> Scalar:
        return self._new(-self.value)

    @_of_numbers
    def __add__(self, other: Any) -> Scalar:
        return self if _is(other, 0.0) else self._new(self.value + plain(other))

    __radd__ = __add__

    @_of_numbers
    def __sub__(self, other: Any) -> Scalar:
        return self if _is(other, 0.0) else self._new(self.value - plain(other))

    @_of_numbers
    def __rsub__(self, other: Any) -> Scalar:
        return -self if _is(other, 0.0) else self._new(plain(other) - self.value)

    @_of_numbers
    def __mul__(self, other: Any) -> Any:
        if _is(other, 0.0):
            return 0.0
        return self if _is(other, 1.0) else self._new(self.value * plain(other))

    __rmul__ = __mul__

    @_of_numbers
    def __truediv__(self, other: Any) -> Scalar:
        return self if _is(other, 1.0) else self._new(self.value / plain(other))

    @_of_numbers
    def __rtruediv__(self, other: Any) -> Any:
        return 0.0 if _is(other, 0.0) else self._new(plain(other) / self.value)

    def __pow__(self, exponent: float) -> Any:
        if exponent == 0.0:
            return 1.0
        return self if exponent == 1.0 else self._new(self.value**exponent)

    def __abs__(self) -> Scalar:
        return self._new(self.library.fabs(self.value))  # abs needs CasADi 3.8

    def __float__(self) -> float:
        """Return the number of a constant expression; a symbol has none."""
        if not self._is_constant:
            raise SymbolError("uses the number of a symbol, for example in a condition")
        return float(self.value)

    @property
    def real(self) -> Scalar:
        """The scalar, which has no imaginary part."""
        return self

    def __round__(self) -> Scalar:
        """Return the nearest whole number, from below at a half."""
        return self._new(self.library.floor(self.value + 0.5))

    def __bool__(self) -> bool:
        """Return the truth value; without this method, every symbol would silently be true."""
        decide = choose.get()
        if decide is None or self._is_constant:
            return bool(float(self))
        return decide(self.value)

    @property
    def _is_constant(self) -> bool:
        is_constant = getattr(self.value, "is_constant", None)
        return is_constant is not None and bool(is_constant())

    def arctan2(self, x: Any) -> Scalar:
        """Angle of the point (x, self)."""
        return self._new(self.library.arctan2(self.value, plain(x)))


def _method(name: str) -> Callable[[Scalar], Scalar]:
    """Return the method that NumPy calls when its function is applied to an object."""
    return lambda self: self._new(getattr(self.library, name)(self.value))


#: Functions of NumPy that are methods of `Scalar`.
FUNCTIONS = (
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan"),
    *("sinh", "cosh", "tanh", "arctanh", "exp", "log", "sqrt"),
)
for _name in FUNCTIONS:
    setattr(Scalar, _name, _method(_name))


def _comparison(compare: Callable[[Any, Any], Any]) -> Callable[[Scalar, Any], Scalar]:
    return _of_numbers(lambda self, other: self._new(compare(self.value, plain(other))))


for _compare in (lt, le, gt, ge, eq, ne):
    setattr(Scalar, f"__{_compare.__name__}__", _comparison(_compare))


def _is(other: Any, number: float) -> bool:
    return isinstance(other, int | float) and other == number


def plain(number: Any) -> Any:
    """Return the library's own scalar; return a number unchanged."""
    return number.value if isinstance(number, Scalar) else number


def objects(scalars: Iterable[Any], library: Any) -> Objects:
    """Return scalars of a library as an array of objects (k,)."""
    listed = [Scalar(scalar, library) for scalar in scalars]
    array = np.empty(len(listed), dtype=object)
    array[:] = listed
    return array


@cache
def symbolic(kernel: Callable[..., Any]) -> Callable[..., Any]:
    """Return the plain function of a kernel, for arrays of objects."""
    # Use NumPy's tanh, because automatic differentiation of the kernels' tanh, which is made for
    # complex numbers, gives slope 0 at 0.
    return undecorated(kernel, {tanh: np.tanh, tip_motion: _tip_motion})


def _tip_motion(
    sizes: Any, constants: ArmConstants, state: Objects, _: Any, body_poses: Any, tip: Objects,
    position: Objects, velocity: Objects, jacobian: Objects, bias: Objects,
) -> None:  # fmt: skip
    """Fill the results of ``tip_motion`` by derivatives of CasADi instead of complex steps."""
    import casadi

    n = len(jacobian[0])
    symbols = casadi.SX.sym("motion", 2 * n)
    moved, angles = np.zeros(state.shape, dtype=object), state[:, :, 0].ravel()
    moved[:, :, 0] = objects(casadi.vertsplit(symbols), casadi).reshape(2, n)
    body_poses, tip = body_poses.astype(object), tip.astype(object)
    symbolic(poses)(sizes, constants, moved, body_poses, tip)
    place, speed = (casadi.vertcat(*map(plain, tip[k : k + 2])) for k in (0, 3))
    slopes = casadi.jacobian(speed, symbols)
    drift = slopes[:, :n] @ symbols[n:]
    results = casadi.horzcat(place, speed, drift, slopes[:, n:])
    function = casadi.Function("tip_motion", [symbols], [casadi.densify(results)])
    values = function(casadi.vertcat(*map(plain, angles)))
    rows = [objects(casadi.horzsplit(row), casadi) for row in casadi.vertsplit(values)]
    for axis, (position[axis], velocity[axis], bias[axis], *columns) in enumerate(rows):
        jacobian[axis] = columns


Force = Objects | None


class KernelCalls:
    """Kernels of one arm, evaluated over objects.

    ``gauge_rows`` (gauges, m) are the strains per modal coordinate of the ``gauge_bodies``;
    ``free`` (n,) replaces the values of the constants in ``forward_dynamics``: 0 for a joint with a
    prescribed acceleration.
    """

    def __init__(
        self, arm: Arm, constants: ArmConstants, gauge_bodies: Any, gauge_rows: Objects, free: Any
    ) -> None:
        self.arm, self.constants = arm, constants
        self.gauge_bodies, self.gauge_rows = gauge_bodies, gauge_rows
        self.free = free
        self._sizes = run_time_sizes(arm.assembly.constants)

    def forward_dynamics(
        self, q: Objects, qd: Objects, torque: Objects, tip_force: Force = None
    ) -> Objects:
        """Return qdd (dof,); the entry of a prescribed joint in ``torque`` is its acceleration."""
        return self.arm.unpadded(self._moved(q, qd, torque, tip_force).acceleration)

    def closure_forces(
        self, q: Objects, qd: Objects, torque: Objects, tip_force: Force = None
    ) -> Objects:
        """Return the forces of closures (closure_rows,)."""
        return np.asarray(self._moved(q, qd, torque, tip_force).closure[:, MULTIPLIER])

    def closure_gaps(self, q: Objects) -> Objects:
        """Return how far the loops are from closed (closure_rows,)."""
        work = self._work()
        symbolic(closure_gaps)(self._sizes, self.constants, self._state(q, _zeros(q)), work)
        return np.asarray(work.closure[:, GAP])

    def _moved(self, q: Objects, qd: Objects, torque: Objects, tip_force: Force) -> Workspace:
        """Return the workspace after forward dynamics."""
        constants = self.constants._replace(body=self.constants.body.copy())
        constants.free[:] = self.free
        work, drive = self._work(), self.arm.padded_torque(torque)
        state, loads = self._state(q, qd), self._loads(tip_force)
        symbolic(forward_dynamics)(self._sizes, constants, state, drive, loads, work)
        return work

    def inverse_dynamics(
        self, q: Objects, qd: Objects, qdd: Objects, tip_force: Force = None,
        closure_forces: Force = None,
    ) -> Objects:  # fmt: skip
        """Return the generalised force M qdd + bias (dof,), less that of closures."""
        return self.arm.unpadded(self._newton_euler(q, qd, qdd, tip_force, closure_forces).force)

    def residual(
        self, q: Objects, qd: Objects, qdd: Objects, torque: Objects, tip_force: Force = None,
        closure_forces: Force = None,
    ) -> Objects:  # fmt: skip
        """Return M qdd + bias - torque (dof,)."""
        force = self.inverse_dynamics(q, qd, qdd, tip_force, closure_forces)
        force[self.arm.joint_index] -= torque
        return force

    def bias_force(self, q: Objects, qd: Objects) -> Objects:
        """Return the force (dof,) at zero acceleration."""
        return self.inverse_dynamics(q, qd, _zeros(q))

    def joint_reactions(
        self, q: Objects, qd: Objects, qdd: Objects, tip_force: Force = None,
        closure_forces: Force = None,
    ) -> Objects:  # fmt: skip
        """Return force and moment on each link at its root: (links, 3), Fx, Fy, Mz, world axes."""
        work = self._newton_euler(q, qd, qdd, tip_force, closure_forces)
        world = np.zeros((len(work.wrench), 3), dtype=object)
        turns: list[tuple[Any, Any]] = []
        carriers = carriers_of(self.arm)
        for i, (turn_cosine, turn_sine) in enumerate(work.rotation):
            carrier = carriers[i]
            cosine, sine = turns[carrier] if carrier >= 0 else (1.0, 0.0)
            turned = cosine * turn_cosine - sine * turn_sine
            cosine, sine = turned, sine * turn_cosine + cosine * turn_sine
            turns.append((cosine, sine))
            x, y, moment = work.wrench[i]
            world[i] = cosine * x - sine * y, sine * x + cosine * y, moment
        return world[self.arm.assembly.link_root]

    def section_forces(self, q: Objects, qd: Objects, qdd: Objects, cuts: Sequence[Cut]) -> Objects:
        """Return axial force, shear force and bending moment in sections: (links, cuts, 3).

        The parts of the links inboard of the sections have the numbers of the arm.
        """
        work, nothing = self._newton_euler(q, qd, qdd, None, None), self._loads(None)
        motion = self._state(q, qd), self.arm.padded(qdd)
        return forces_at(self.arm, cuts, *motion, (), nothing, work, symbolic(section_forces))

    def mass_matrix(self, q: Objects) -> Objects:
        """Return M (dof, dof)."""
        n, width = self.arm.assembly.bodies, 1 + self.arm.assembly.modes
        M = np.zeros((n, width, n, width), dtype=object)
        state = self._state(q, _zeros(q))
        symbolic(mass_matrix)(self._sizes, self.constants, state, self._work(), M)
        kept = self.arm.assembly.coordinates
        return np.asarray(M.reshape(n * width, n * width)[np.ix_(kept, kept)])

    def energy(self, q: Objects, qd: Objects) -> Objects:
        """Return kinetic, strain and gravity energy (3,)."""
        body_poses, tip = self._poses()
        values = np.zeros(3, dtype=object)
        state = self._state(q, qd)
        symbolic(energies)(self._sizes, self.constants, state, body_poses, tip, values)
        return values

    def tip(self, q: Objects) -> Objects:
        """Return x, y and angle of the last tip (3,)."""
        return self._tip(q, _zeros(q))[:3]

    def tip_velocity(self, q: Objects, qd: Objects) -> Objects:
        """Return the rates of ``tip`` (3,)."""
        return self._tip(q, qd)[3:]

    def strain(self, q: Objects) -> Objects:
        """Return the strain at each gauge (gauges,)."""
        strains = np.zeros((1, len(self.gauge_bodies)), dtype=object)
        states = self._state(q, _zeros(q))[None]
        symbolic(gauge_strains)(self._sizes, states, self.gauge_bodies, self.gauge_rows, strains)
        return np.asarray(strains[0])

    def point_motions(self, q: Objects, qd: Objects, torque: Objects, stations: Loads) -> Objects:
        """Return position, velocity and accelerations of points; columns as in the kernel."""
        work, (body_poses, tip) = self._work(), self._poses()
        acceleration = self.arm.padded(self.forward_dynamics(q, qd, torque))
        motions = np.zeros((len(stations.body), MOTION_COLUMNS), dtype=object)
        symbolic(point_motions)(
            self._sizes, self.constants, self._state(q, qd), acceleration, self._loads(None),
            stations, work, body_poses, tip, motions,
        )  # fmt: skip
        return motions

    def _tip(self, q: Objects, qd: Objects) -> Objects:
        body_poses, tip = self._poses()
        symbolic(poses)(self._sizes, self.constants, self._state(q, qd), body_poses, tip)
        return tip

    def _newton_euler(
        self, q: Objects, qd: Objects, qdd: Objects, tip_force: Force, closure_forces: Force
    ) -> Workspace:
        work, acceleration = self._work(), self.arm.padded(qdd)
        if closure_forces is not None:
            work.closure[:, MULTIPLIER] = closure_forces
        state, loads = self._state(q, qd), self._loads(tip_force)
        symbolic(inverse_dynamics)(self._sizes, self.constants, state, acceleration, loads, work)
        return work

    def _state(self, q: Objects, qd: Objects) -> Objects:
        return np.asarray(self.arm.padded(np.stack([q, qd])))

    def _work(self) -> Workspace:
        return new_workspace(self.constants, object)

    def _poses(self) -> tuple[Objects, Objects]:
        n = self.arm.assembly.bodies
        return np.zeros((n, POSE_COLUMNS), dtype=object), np.zeros(6, dtype=object)

    def _loads(self, force: Force) -> Loads:
        """Place a force (3,) on the last tip; None for no force."""
        if force is None:
            return no_loads(self.arm.assembly.constants)
        placed = place_loads(self.arm, tip_load(self.arm, np.ones(3)))
        i, own = placed.body, self.constants
        # Use the object constants, because the shapes at the tip may depend on parameters.
        return placed._replace(
            lever=own.length[i],
            rows=own.P[i],
            slopes=own.dP[i],
            shortening=own.G[i],
            value=force[None],
        )


def _zeros(q: Objects) -> Objects:
    return np.zeros(len(q), dtype=object)


class ParametricArm:
    """Arm whose constants are functions of parameters, with prescribed joints by number.

    ``nominal`` (k,) are the values of the parameters in the arm. A path must have an exact formula.
    """

    def __init__(self, arm: Arm, paths: Sequence[str], prescribed: Sequence[int]) -> None:
        self.arm = arm
        self.paths = tuple(check_list_of("parameters", paths, str))
        names = [f"parameters[{k}]" for k in range(len(self.paths))]
        self.nominal = np.array(
            [number_at(name, arm.spec, path) for name, path in zip(names, self.paths, strict=True)]
        )
        for k, path in enumerate(self.paths):
            if path in self.paths[:k]:
                raise InputError(Problem(names[k], f"repeats {path}"))
            check_closed_form(names[k], arm, path)
        self._free = _free(arm, prescribed)
        warn_of_bristles(arm, "the exported model")

    def at(self, values: Sequence[Any]) -> KernelCalls:
        """Return the kernels for values of the parameters, `Scalar` objects or numbers."""
        given = dict(zip(self.paths, values, strict=True))
        constants, rows = constants_at(self.arm, given)
        bodies = place_gauges(self.arm, self.arm.gauges)[1]
        return KernelCalls(self.arm, constants, bodies, rows, self._free)


def _free(arm: Arm, prescribed: Sequence[int]) -> FloatArray:
    """Return which joints are free, (n,) by bodies: 1, or 0 if prescribed or fixed."""
    free = arm.assembly.constants.free.copy()
    for k, joint in enumerate(check_list_of("prescribed", prescribed, int)):
        free[arm.assembly.joint_body[check_joint(arm, f"prescribed[{k}]", joint)]] = 0.0
    return free
