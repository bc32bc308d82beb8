"""Functions of CasADi with the names and sizes that they have in C."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi


@dataclass(frozen=True, eq=False)
class NamedFunction:
    """Function of the exported code.

    Attributes:
        name: name in C, without the prefix of the arm.
        summary: first sentence of its comment.
        function: of CasADi, with dense outputs. Matrices are transposed, because C stores rows.
    """

    name: str
    summary: str
    function: casadi.Function

    @property
    def inputs(self) -> list[str]:
        """Names of the inputs; those of size zero do not exist in C."""
        sizes = [self.function.numel_in(k) for k in range(self.function.n_in())]
        return [name for name, size in zip(self.function.name_in(), sizes, strict=True) if size]

    @property
    def memory(self) -> str | None:
        """Name of the array that the caller keeps between samples, or None."""
        found = [name for name in self.function.name_out() if name.endswith("memory_out")]
        return found[0].removesuffix("_out") if found else None

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
