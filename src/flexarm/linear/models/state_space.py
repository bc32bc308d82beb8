"""Linear state-space models with named states, inputs and outputs."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.actions import marker, place_loads
from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice, library_missing
from flexarm.base.errors import InputError, Problem, check_array, one_of, public_call, shown
from flexarm.base.late import linalg
from flexarm.base.notebook import html_table
from flexarm.model import Load, Sensor

if TYPE_CHECKING:
    import control

_AXES = ("x", "y")


class Input(NamedTuple):
    """One scalar input; exactly one of ``joint``, ``load`` and ``axis`` is set."""

    name: str
    unit: str
    joint: int | None = None  # position among the joints
    gain: float = 1.0  # torque (N m) of a joint by the input
    load: Load | None = None  # the load of a unit input
    axis: int | None = None  # axis of the acceleration of the base


class Output(NamedTuple):
    """Outputs that are evaluated together: a channel of results, the torque, or a sensor."""

    names: tuple[str, ...]
    unit: str
    channel: str | None = None
    sensor: Sensor | None = None


#: Channels of results that can be outputs: the objects that count their columns, and the unit.
CHANNEL_OUTPUTS = {
    "joint_angle": ("joint", "rad"),
    "joint_rate": ("joint", "rad/s"),
    "joint_twist": ("joint", "rad"),
    "link_angle": ("link", "rad"),
    "link_rate": ("link", "rad/s"),
    "link_tip_deflection": ("link", "m"),
    "link_tip_slope": ("link", "rad"),
    "link_tip_deflection_rate": ("link", "m/s"),
    "link_tip_slope_rate": ("link", "rad/s"),
    "tip": ("axis", "m"),
    "tip_velocity": ("axis", "m/s"),
    "tip_angle": ("", "rad"),
    "tip_angle_rate": ("", "rad/s"),
    "strain": ("gauge", "1"),
    "torque": ("joint", "N m"),
    "contact_force": ("contact", "N"),
    "contact_gap": ("contact", "m"),
}
INPUTS = ("torque", "voltage", "tip_force", "tip_moment", "base_acceleration")

InputName = str | Load | tuple[str, Load]
OutputName = str | Sensor


def find_inputs(arm: Arm, requested: Sequence[InputName]) -> list[Input]:
    """Return the inputs for the names and loads that the user gives, each with a different name."""
    found: list[Input] = []
    loads = 0
    for item in _listed(requested):
        if isinstance(item, str):
            found += _named_inputs(arm, item)
            continue
        loads += 1
        name, load = (
            item if isinstance(item, tuple) and len(item) == 2 else (f"load[{loads}]", item)
        )
        if not isinstance(load, Load):
            rule = "be names, Load objects, or pairs of a name and a Load"
            raise InputError(Problem("inputs", rule, shown(item)))
        unit = "N/m" if load.spread is not None else "N" if np.any(load.force) else "N m"
        if load.factor is None and np.any(load.value):
            # The numbers of the load give its direction; the input scales them.
            found.append(Input(str(name), f"x {unit}", load=load))
        else:
            rule = "have a nonzero force or moment, and no factor"
            raise InputError(Problem(f"inputs {name!r}", rule, shown(load.value)))
    _check_names("inputs", [item.name for item in found])
    return found


def _named_inputs(arm: Arm, name: str) -> list[Input]:
    last = arm.n_links
    if name == "torque":
        return [Input(f"torque[{n}]", "N m", joint=k) for k, n in enumerate(arm.joint_numbers)]
    if name == "voltage":  # the damping of these joints contains the back-EMF
        voltages = [
            Input(f"voltage[{n}]", "V", joint=k, gain=arm.spec.joints[n - 1].torque_per_voltage)
            for k, n in enumerate(arm.joint_numbers)
            if arm.spec.joints[n - 1].winding is not None
        ]
        if voltages:
            return voltages
        hint = "Give its joints a winding: fa.Joint(..., winding=fa.Winding(...))."
        rule = "contain voltage, but no joint has a winding"
        raise InputError(Problem("inputs", rule, hint=hint))
    if name == "tip_force":
        forces = ((1.0, 0.0), (0.0, 1.0))
        return [
            Input(f"tip_force[{axis}]", "N", load=Load(link=last, force=force))
            for axis, force in zip(_AXES, forces, strict=True)
        ]
    if name == "tip_moment":
        return [Input("tip_moment", "N m", load=Load(link=last, moment=1.0))]
    if name == "base_acceleration":
        return [Input(f"base_acceleration[{a}]", "m/s^2", axis=k) for k, a in enumerate(_AXES)]
    rule = "be a Load or one of " + ", ".join(map(repr, INPUTS))
    raise InputError(Problem("inputs", rule, shown(name)))


def find_outputs(arm: Arm, requested: Sequence[OutputName], contacts: int = 0) -> list[Output]:
    """Return the outputs for names and sensors, with the contacts at the operating point."""
    counts = {"link": arm.n_links, "gauge": len(arm.gauges), "contact": contacts}
    counted = {by: [str(n) for n in range(1, count + 1)] for by, count in counts.items()}
    counted |= {"joint": [str(n) for n in arm.joint_numbers], "axis": list(_AXES)}
    found = []
    for item in _listed(requested):
        if isinstance(item, Sensor):
            place_loads(arm, [marker(item.link, item.station)], what="Sensor")
            found.append(Output(tuple(item.labels()), item.unit, sensor=item))
            continue
        if not isinstance(item, str) or item not in CHANNEL_OUTPUTS:
            rule, hint = one_of(item, CHANNEL_OUTPUTS, "a Sensor or ")
            raise InputError(Problem("outputs", rule, shown(item), hint))
        if item == "strain" and not arm.gauges:
            raise InputError(Problem("outputs", "contain strain, but the arm has no gauges"))
        by, unit = CHANNEL_OUTPUTS[item]
        if by == "contact" and not contacts:
            raise InputError(Problem("outputs", f"contain {item}, but there are no contacts"))
        if item == "contact_force":
            forces = (f"{item}[{n},{axis}]" for n in range(1, contacts + 1) for axis in _AXES)
            found.append(Output(tuple(forces), unit, channel=item))
            continue
        names = tuple(f"{item}[{n}]" for n in counted[by]) if by else (item,)
        found.append(Output(names, unit, channel=item))
    _check_names("outputs", [name for item in found for name in item.names])
    return found


def component_places(labels: Sequence[str], names: Iterable[str]) -> list[int]:
    """Return the places of the components of named signals in labels, by the order of the names."""
    return [
        k
        for name in names
        for k, label in enumerate(labels)
        if label == name or label.startswith(f"{name}[")
    ]


def _listed(requested: object) -> list[object]:
    """Return a list of names; a single name becomes a list of one."""
    pair = isinstance(requested, tuple) and len(requested) == 2 and isinstance(requested[1], Load)
    if isinstance(requested, (str, Load, Sensor)) or pair:
        return [requested]
    if not isinstance(requested, list | tuple):
        rule = "be names, Loads or Sensors"
        raise InputError(Problem("inputs and outputs", rule, shown(requested)))
    return list(requested)


def _check_names(which: str, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        rule = "have different names"
        hint = "Give a Sensor or a Load its own name."
        raise InputError(Problem(which, rule, ", ".join(twice), hint))
    dotted = next((name for name in names if "." in name), None)
    if dotted is not None:
        rule = "have names without dots (python-control splits names at dots)"
        raise InputError(Problem(which, rule, shown(dotted)))


def state_names(arm: Arm) -> tuple[list[str], list[str]]:
    """Return names and units of the states: the coordinates, then their rates, 2 dof of each."""
    names = [""] * arm.dof
    rates = [""] * arm.dof
    units = ["m kg^0.5"] * arm.dof
    for seat in arm.assembly.seats:
        n = seat.link + 1
        names[seat.angle], rates[seat.angle] = f"joint_angle[{n}]", f"joint_rate[{n}]"
        units[seat.angle] = "rad" if arm.spec.joints[seat.link].kind == "revolute" else "m"
        if seat.twist is not None:
            names[seat.twist], rates[seat.twist] = f"joint_twist[{n}]", f"joint_twist_rate[{n}]"
            units[seat.twist] = "rad"
    for coordinate in arm.assembly.base:
        place, name = coordinate.place, f"base_{coordinate.name}"
        names[place], rates[place] = name, f"{name}_rate"
        units[place] = "rad" if coordinate.name == "angle" else "m"
    counts = [0] * arm.n_links
    for piece in arm.assembly.pieces:
        for place in range(piece.modal.start, piece.modal.stop):
            counts[piece.link] += 1
            number = f"[{piece.link + 1},{counts[piece.link]}]"
            names[place], rates[place] = f"mode{number}", f"mode_rate{number}"
    return names + rates, units + [f"{unit}/s" for unit in units]


def torque_places(inputs: list[Input], joints: int) -> FloatArray:
    """Return the derivative (joints, inputs) of the torque by the inputs, N m per unit of each."""
    matrix = np.zeros((joints, len(inputs)))
    for column, item in enumerate(inputs):
        if item.joint is not None:
            matrix[item.joint, column] = item.gain
    return matrix


def control_system(model: Any, **options: Any) -> control.StateSpace:
    """Convert a linear model to a state-space system of python-control with the same names."""
    try:
        import control
    except ImportError:
        raise library_missing("python-control", "control") from None
    matrices = model.A, model.B, model.C, model.D
    options |= {"inputs": list(model.inputs), "outputs": list(model.outputs)}
    return control.StateSpace(*matrices, remove_useless_states=False, **options)


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
    """Base of linear models: matrices, and names of inputs and outputs."""

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray

    def __repr__(self) -> str:
        of: Any = self
        sizes = f"{len(of.A)} states, {len(of.inputs)} inputs, {len(of.outputs)} outputs"
        return f"<flexarm.{type(self).__name__}: {sizes}{self._about()}>"

    def _about(self) -> str:
        """Return further words for the description, with a comma; none here."""
        return ""

    @public_call
    def frequency_response(self, omega: Any) -> NDArray[np.complex128]:
        """Return the response to harmonic inputs, (frequencies, outputs, inputs), complex.

        The unit is output unit per input unit. NaN at the frequency of an undamped pole, where no
        steady response exists.

        Args:
            omega: (frequencies,) rad/s, or one number, whose response is (outputs, inputs).

        Raises:
            InputError: if ``omega`` is not a finite number or an array of them.
        """
        single = isinstance(omega, int | float | np.number)
        omega = check_array("omega", omega, () if single else (-1,))
        response = self._response(np.atleast_1d(omega))
        return response if omega.ndim else response[0]

    def _response(self, omega: FloatArray) -> NDArray[np.complex128]:
        """Return the response at frequencies (f,), rad/s."""
        return frequency_response(self.A, self.B, self.C, self.D, omega)


@dataclass(frozen=True, eq=False, repr=False)
class LinearModel(StateSpaceModel):
    """Linear model of small deviations: x' = A x + B u, y = C x + D u; (S.1), (S.2).

    Attributes:
        A, B, C, D: (2 dof, 2 dof), (2 dof, inputs), (outputs, 2 dof), (outputs, inputs).
        states, inputs, outputs: names; ``units`` maps each to its unit.
        mass, damping, stiffness: (dof, dof) matrices of M q'' + D q' + K q = forces, the same model
            in second-order form; gyroscopic and centrifugal terms included.
        q, qd, torque: the operating point, (dof,), (dof,), (joints,) N m.
        drift: (2 dof,) rate of the state at the operating point, zero at an equilibrium; otherwise
            a constant term of x' that the model omits.
        output: (outputs,) values of the outputs at the operating point.

    For a mechanism with closures, read dof as the number of independent coordinates everywhere but
    in ``q`` and ``qd``; ``states`` names them.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str]
    mass: FloatArray
    damping: FloatArray
    stiffness: FloatArray
    q: FloatArray
    qd: FloatArray
    torque: FloatArray
    drift: FloatArray
    output: FloatArray
    references: ClassVar[str] = "SquireTrapp1998"

    def _repr_html_(self) -> str:
        signals = {"input": self.inputs, "output": self.outputs, "state": self.states}
        rows = [(kind, name, self.units[name]) for kind in signals for name in signals[kind]]
        return html_table(repr(self).strip("<>"), ("signal", "name", "unit"), rows)

    @property
    def poles(self) -> Any:
        """Eigenvalues of A (2 dof,), complex, 1/s, in ascending magnitude."""
        return slowest_first(linalg.eigvals(self.A))

    @public_call
    def zeros(self, input: str | None = None, output: str | None = None) -> Any:
        """Return the transmission zeros of one input and one output (zeros,), complex, 1/s.

        In ascending magnitude. On a fine mesh they are more accurate than those that python-control
        computes from the same matrices, because the states are scaled and zeros at infinity are
        removed beforehand.

        Args:
            input, output: names; optional if the model has only one.

        Raises:
            InputError: if the name is unknown, or is omitted and the model has more than one.
        """
        k, j = self._place("output", output), self._place("input", input)
        return _transmission_zeros(self.A, self.B[:, j], self.C[k], float(self.D[k, j]))

    def _place(self, kind: str, name: str | None) -> int:
        names: tuple[str, ...] = getattr(self, f"{kind}s")
        if name is None and len(names) == 1:
            return 0
        return names.index(check_choice(kind, name, names))

    @public_call
    def to_control(self) -> control.StateSpace:
        """Convert to a state-space system of python-control with the same names.

        Raises:
            InputError: if python-control is not installed.
        """
        return control_system(self, states=list(self.states))

    def arrays(self) -> dict[str, Any]:
        """Return all arrays and names in a dictionary for ``scipy.io.savemat`` or JSON."""
        numeric = ("A", "B", "C", "D", "mass", "damping", "stiffness")
        point = ("q", "qd", "torque", "drift", "output")
        named = ("states", "inputs", "outputs")
        found: dict[str, Any] = {name: getattr(self, name) for name in (*numeric, *point)}
        for name in named:
            labels = getattr(self, name)
            found[name] = list(labels)
            found[f"{name.removesuffix('s')}_units"] = [self.units[label] for label in labels]
        return found


#: A matrix counts as singular if its solution exceeds that of a regular one by this factor.
_SINGULAR = 1e13


def slowest_first(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return eigenvalues by ascending magnitude, then stable before unstable, then by sign.

    Magnitudes are compared to nine digits, because the last digits differ between machines and
    would change the order of a conjugate pair.
    """
    size = np.abs(values)
    direction = np.round(values / np.maximum(size, np.finfo(float).tiny), 9)
    digits = np.array([float(f"{one:.8e}") for one in size])
    return values[np.lexsort((values.imag, direction.real, np.abs(direction.imag), digits))]


def balanced(A: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a matrix similar to A with rows and columns of equal norms, and the scales (n,).

    The scales are powers of two. By LAPACK, because SciPy's own function casts them to integers,
    and those of states that hardly affect others are larger than any.
    """
    if not A.size:
        return A, np.ones(0)
    scaled, _, _, scale, _ = linalg.lapack.dgebal(np.asarray_chkfinite(A), scale=1, permute=0)
    return scaled, scale


def frequency_response(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, omega: FloatArray
) -> NDArray[np.complex128]:
    """Return C (i omega - A)^-1 B + D, (frequencies, outputs, inputs); NaN at undamped poles."""
    A, scale = balanced(A)
    B, C = B / scale[:, None], C * scale
    dynamic = np.asarray(1j * omega[:, None, None] * np.eye(len(A)) - A, dtype=np.complex128)
    states = solved_each(dynamic, B)
    # Norms of the scaled matrices, because squares of huge frequencies overflow.
    least = np.finfo(float).tiny
    size = np.abs(dynamic).max(axis=(1, 2), keepdims=True, initial=least)
    growth = np.linalg.norm(dynamic / size, axis=(1, 2))
    growth *= np.linalg.norm(states * size, axis=(1, 2))
    states[~(growth < _SINGULAR * np.linalg.norm(B))] = np.nan
    return np.asarray(C @ states + D)


def solved_each(matrices: NDArray[np.complex128], B: FloatArray) -> NDArray[np.complex128]:
    """Solve with many matrices; return NaN for those that are exactly singular."""
    right = np.broadcast_to(B, (len(matrices), *B.shape))
    try:
        return np.asarray(np.linalg.solve(matrices, right), dtype=complex)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full(right.shape, complex(np.nan, np.nan))
    return np.concatenate([solved_each(matrices[k : k + 1], B) for k in range(len(matrices))])


def _transmission_zeros(A: FloatArray, b: FloatArray, c: FloatArray, d: float) -> Any:
    """Return the transmission zeros of one input and one output (zeros,), complex, 1/s.

    In ascending magnitude, from the matrices, because the coefficients of the polynomials of a
    transfer function lose all digits with twenty states. A zero is an s for which a state x and an
    input u other than zero exist with s x = A x + b u and c x + d u = 0. Without feedthrough the
    pencil of these equations has eigenvalues at infinity whose rounding errors affect the finite
    ones, so they are removed beforehand. For a velocity (c b not zero), x is in the null space of
    c; for a position, it is in that of c and c A. Only the equations orthogonal to b, and for a
    position to c, are independent of these constraints. The states are scaled first, because
    coordinates and their rates differ by a factor of the highest frequency, 1e5 on a fine mesh.

    Source: A. Emami-Naeini and P. Van Dooren, Computation of zeros of linear multivariable systems,
    Automatica 18 (1982) 415-430, for the pencil and for the deflation of infinite zeros.
    """
    if not ((np.any(b) and np.any(c)) or d != 0.0):
        return np.zeros(0, dtype=complex)  # no effect at any frequency
    A, scale = balanced(A)
    b, c = b / scale, c * scale
    if d != 0.0:
        found = linalg.eigvals(A - np.outer(b, c) / d)
    else:
        # Scales are powers of two, so that the product of a position and a force is exactly zero.
        constraints = np.array([c] if c @ b != 0.0 else [c, c @ A])
        constraints /= np.linalg.norm(constraints, axis=1, keepdims=True)
        orthogonal = np.vstack([b / np.linalg.norm(b), constraints[:-1]])
        allowed, equations = linalg.null_space(constraints), linalg.null_space(orthogonal)
        # The direct effect of a torque on a distant point decreases with each element, so on a fine
        # mesh the magnitude of a zero may exceed the range of floating-point numbers.
        if allowed.shape[1] == 0:
            return np.zeros(0, dtype=complex)
        found = linalg.eigvals(equations.T @ A @ allowed, equations.T @ allowed)
        found = found[np.isfinite(found)]
    return slowest_first(found)
