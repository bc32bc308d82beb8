"""Evaluation of a control law that was recorded as a list of elementary operations."""

from __future__ import annotations

from typing import NamedTuple

from flexarm.kernels.compilation.cache import compiled, inner
from flexarm.kernels.compilation.numbers import sqrt
from flexarm.kernels.layout import Array

#: Codes of the operations; those of NumPy with the same names.
OPERATIONS = (
    "add",
    "subtract",
    "multiply",
    "divide",
    "minimum",
    "maximum",
    "less",
    "less_equal",
    "greater",
    "greater_equal",
    "negative",
    "absolute",
    "sqrt",
    "where",
)
(
    _ADD,
    _SUBTRACT,
    _MULTIPLY,
    _DIVIDE,
    _MINIMUM,
    _MAXIMUM,
    _LESS,
    _LESS_EQUAL,
    _GREATER,
    _GREATER_EQUAL,
    _NEGATIVE,
    _ABSOLUTE,
    _SQRT,
    _WHERE,
) = range(len(OPERATIONS))


class LawProgram(NamedTuple):
    """A recorded step of a law. A *place* is an index in ``numbers``; truth values are 0 and 1."""

    code: Array  # (operations, 5) integers: operation, place of the result, places of operands
    numbers: Array  # (places,) with the constants of the law
    memory: Array  # (k,) places of the memory before the step
    readings: Array  # (p,) places of joint angles, joint rates and strains
    inputs: Array  # (r,) places of the planned inputs
    after: Array  # (k,) places of the memory after the step
    torque: Array  # (joints,) places of the torques
    kept: Array  # (k,) scratch


@compiled
def law_step(program: LawProgram) -> None:
    """Evaluate the operations, from numbers that have been written to the places of a sample."""
    code, x = program.code, program.numbers
    for k in range(code.shape[0]):
        operation, to, a, b = code[k, 0], code[k, 1], x[code[k, 2]], x[code[k, 3]]
        if operation == _ADD:
            x[to] = a + b
        elif operation == _MULTIPLY:
            x[to] = a * b
        elif operation == _SUBTRACT:
            x[to] = a - b
        elif operation == _DIVIDE:
            x[to] = a / b
        elif operation == _MINIMUM:
            x[to] = a if a <= b or a != a else b
        elif operation == _MAXIMUM:
            x[to] = a if a >= b or a != a else b
        elif operation == _LESS:
            x[to] = 1.0 if a < b else 0.0
        elif operation == _LESS_EQUAL:
            x[to] = 1.0 if a <= b else 0.0
        elif operation == _GREATER:
            x[to] = 1.0 if a > b else 0.0
        elif operation == _GREATER_EQUAL:
            x[to] = 1.0 if a >= b else 0.0
        elif operation == _NEGATIVE:
            x[to] = -a
        elif operation == _ABSOLUTE:
            x[to] = abs(a)
        elif operation == _SQRT:
            x[to] = sqrt(a)
        else:
            x[to] = b if a != 0.0 else x[code[k, 4]]


@inner
def remember(program: LawProgram) -> None:
    """Let the memory after the step be that of the next one."""
    for k in range(program.after.shape[0]):
        program.kept[k] = program.numbers[program.after[k]]
    for k in range(program.after.shape[0]):
        program.numbers[program.memory[k]] = program.kept[k]
