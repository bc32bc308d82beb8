"""Linear state-space models with named states, inputs and outputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.base.arguments import check_choice, library_missing
from flexarm.base.errors import check_frequencies, public_call
from flexarm.base.notebook import html_table

if TYPE_CHECKING:
    import control


def control_system(model: Any, **options: Any) -> control.StateSpace:
    """Convert a linear model to a state-space system of python-control with the same names.

    Raises:
        InputError: if python-control is not installed.
    """
    try:
        import control
    except ImportError:
        raise library_missing("python-control", "control") from None
    return control.StateSpace(
        model.A,
        model.B,
        model.C,
        model.D,
        inputs=list(model.inputs),
        outputs=list(model.outputs),
        remove_useless_states=False,
        **options,
    )


@dataclass(frozen=True, eq=False)
class LinearModel:
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
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    units: dict[str, str] = field(repr=False)
    mass: FloatArray = field(repr=False)
    damping: FloatArray = field(repr=False)
    stiffness: FloatArray = field(repr=False)
    q: FloatArray = field(repr=False)
    qd: FloatArray = field(repr=False)
    torque: FloatArray = field(repr=False)
    drift: FloatArray = field(repr=False)
    output: FloatArray = field(repr=False)
    references: ClassVar[str] = "SquireTrapp1998"

    def __repr__(self) -> str:
        sizes = f"{len(self.states)} states, {len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<flexarm.LinearModel: {sizes}>"

    def _repr_html_(self) -> str:
        signals = {"input": self.inputs, "output": self.outputs, "state": self.states}
        rows = [(kind, name, self.units[name]) for kind in signals for name in signals[kind]]
        return html_table(repr(self).strip("<>"), ("signal", "name", "unit"), rows)

    @property
    def poles(self) -> Any:
        """Eigenvalues of A (2 dof,), complex, 1/s, in ascending magnitude."""
        from scipy.linalg import eigvals

        return slowest_first(eigvals(self.A))

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
        omega = check_frequencies(omega)
        response = frequency_response(self.A, self.B, self.C, self.D, np.atleast_1d(omega))
        return response if omega.ndim else response[0]

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


def frequency_response(
    A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray, omega: FloatArray
) -> NDArray[np.complex128]:
    """Return C (i omega - A)^-1 B + D, (frequencies, outputs, inputs); NaN at undamped poles."""
    from scipy.linalg import matrix_balance

    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    B, C = B / scale[:, None], C * scale
    dynamic = np.asarray(1j * omega[:, None, None] * np.eye(len(A)) - A, dtype=np.complex128)
    states = _solved(dynamic, B)
    # Norms of the scaled matrices, because squares of huge frequencies overflow.
    least = np.finfo(float).tiny
    size = np.abs(dynamic).max(axis=(1, 2), keepdims=True, initial=least)
    growth = np.linalg.norm(dynamic / size, axis=(1, 2))
    growth *= np.linalg.norm(states * size, axis=(1, 2))
    states[~(growth < _SINGULAR * np.linalg.norm(B))] = np.nan
    return np.asarray(C @ states + D)


def _solved(matrices: NDArray[np.complex128], B: FloatArray) -> NDArray[np.complex128]:
    """Solve with many matrices; return NaN for those that are exactly singular."""
    right = np.broadcast_to(B, (len(matrices), *B.shape))
    try:
        return np.asarray(np.linalg.solve(matrices, right), dtype=complex)
    except np.linalg.LinAlgError:
        if len(matrices) == 1:
            return np.full(right.shape, complex(np.nan, np.nan))
    return np.concatenate([_solved(matrices[k : k + 1], B) for k in range(len(matrices))])


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
    from scipy.linalg import eigvals, matrix_balance, null_space

    if not ((np.any(b) and np.any(c)) or d != 0.0):
        return np.zeros(0, dtype=complex)  # no effect at any frequency
    A, (scale, _) = matrix_balance(A, permute=False, separate=True)
    b, c = b / scale, c * scale
    if d != 0.0:
        found = eigvals(A - np.outer(b, c) / d)
    else:
        # Scales are powers of two, so that the product of a position and a force is exactly zero.
        constraints = np.array([c] if c @ b != 0.0 else [c, c @ A])
        constraints /= np.linalg.norm(constraints, axis=1, keepdims=True)
        orthogonal = np.vstack([b / np.linalg.norm(b), constraints[:-1]])
        allowed, equations = null_space(constraints), null_space(orthogonal)
        # The direct effect of a torque on a distant point decreases with each element, so on a fine
        # mesh the magnitude of a zero may exceed the range of floating-point numbers.
        if allowed.shape[1] == 0:
            return np.zeros(0, dtype=complex)
        found = eigvals(equations.T @ A @ allowed, equations.T @ allowed)
        found = found[np.isfinite(found)]
    return slowest_first(found)
