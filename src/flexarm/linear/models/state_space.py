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
from flexarm.linear.models.transfer import frequency_response, slowest_first, transmission_zeros

if TYPE_CHECKING:
    import control


def control_system(model: Any, **options: Any) -> control.StateSpace:
    """Convert a linear model to a state-space system of python-control with the same names.

    Args:
        model: object with A, B, C, D and the names ``inputs`` and ``outputs``.
        options: further arguments of ``control.StateSpace``.

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
        return transmission_zeros(self.A, self.B[:, j], self.C[k], float(self.D[k, j]))

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
