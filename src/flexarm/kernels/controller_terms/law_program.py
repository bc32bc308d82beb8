"""Evaluation of a control law that was recorded as a list of operations.

They are elementary operations on numbers, and terms of the model of an arm: calls of the kernels
that the law itself calls.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from flexarm.kernels.compilation.cache import apart, compiled, inner
from flexarm.kernels.compilation.numbers import sqrt
from flexarm.kernels.controller_terms.rigid_terms import momentum, regressor
from flexarm.kernels.layout import ArmConstants, Array, Loads, Sizes, Workspace
from flexarm.kernels.recursion.composite_body import mass_matrix
from flexarm.kernels.recursion.newton_euler import inverse_dynamics

#: Elementary operations, those of NumPy with the same names. Codes are indices in this list.
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
    "positive",
    "equal",
    "rint",
)
#: Terms of a model, whose codes follow.
TERMS = ("inverse_dynamics", "mass_matrix", "regressor", "momentum")
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
    _POSITIVE,
    _EQUAL,
    _RINT,
    _FORCES,
    _MASS,
    _REGRESSOR,
    _MOMENTUM,
) = range(len(OPERATIONS) + len(TERMS))


class LawModel(NamedTuple):
    """Model of an arm in a law, n bodies with m modes, with the arrays of its kernels."""

    sizes: Sizes
    constants: ArmConstants
    loads: Loads
    work: Workspace
    state: Array  # (2, n, 1 + m)
    acceleration: Array  # (n, 1 + m)
    mass: Array  # (n, 1 + m, n, 1 + m)
    bodies: Array  # (joints,) integers, of the joints
    motion: Array  # (4, joints) as for ``regressor``; rows 2 and 3 are zero for ``momentum``
    sets: Array  # (k, n, SET_COLUMNS) of ``regressor`` or ``momentum``
    columns: Array  # (k, joints)


class LawProgram(NamedTuple):
    """A recorded step of a law and its devices.

    A *place* is an index in ``numbers``; truth values are 0 and 1.
    """

    code: Array  # (operations, 5) integers: operation, place of the result, places of operands
    numbers: Array  # (places,) with the constants of the law
    memory: Array  # (k,) places of the memory before the step
    readings: Array  # (p,) places of joint angles, joint rates and strains of the arm
    inputs: Array  # (r,) places of the planned inputs
    after: Array  # (k,) places of the memory after the step
    torque: Array  # (joints,) places of the torques of the law
    held: Array  # (pieces, powers, joints) places of the torques of the motors, as in ``Drive``
    noted: Array  # (q,) places of numbers that results contain
    kept: Array  # (k,) scratch
    model: LawModel  # without bodies, if the law has none


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
        elif operation == _WHERE:
            x[to] = b if a != 0.0 else x[code[k, 4]]
        elif operation == _POSITIVE:
            x[to] = a
        elif operation == _EQUAL:
            x[to] = 1.0 if a == b else 0.0
        elif operation == _RINT:
            x[to] = np.rint(a)
        elif operation <= _MASS:
            _forces_or_mass(program.model, operation, x, code[k, 2], to)
        else:
            _of_joints(program.model, operation, code[k, 4], x, code[k, 2], to)


@apart
def _forces_or_mass(model: LawModel, operation: int, x: Array, first: int, to: int) -> None:
    """Evaluate generalised forces (n, 1 + m), or the mass matrix, to the places from ``to`` on.

    Coordinates, rates and accelerations, (n, 1 + m) each, are at the places from ``first`` on.
    """
    n, width = model.acceleration.shape
    size = n * width
    for i in range(n):
        for j in range(width):
            k = first + i * width + j
            model.state[0, i, j] = x[k]
            model.state[1, i, j] = x[k + size]
            model.acceleration[i, j] = x[k + 2 * size]
    if operation == _FORCES:
        inverse_dynamics(
            model.sizes,
            model.constants,
            model.state,
            model.acceleration,
            model.loads,
            model.work,
        )
        for i in range(n):
            for j in range(width):
                x[to + i * width + j] = model.work.force[i, j]
    else:
        mass_matrix(model.sizes, model.constants, model.state, model.work, model.mass)
        for i in range(n):
            for j in range(width):
                for k in range(n):
                    for other in range(width):
                        row = i * width + j
                        x[to + row * size + k * width + other] = model.mass[i, j, k, other]


@apart
def _of_joints(
    model: LawModel, operation: int, inertial: int, x: Array, first: int, to: int
) -> None:
    """Evaluate columns of the regressor, or momentum and its rate, to the places from ``to`` on.

    The four rows of ``model.motion`` are at the places from ``first`` on.
    """
    joints, motion = model.bodies.shape[0], model.motion
    for row in range(4):
        for j in range(joints):
            motion[row, j] = x[first + row * joints + j]
    if operation == _REGRESSOR:
        regressor(
            model.sizes,
            model.constants,
            model.loads,
            model.work,
            model.sets,
            inertial,
            model.bodies,
            motion,
            model.state,
            model.acceleration,
            model.columns,
        )
    else:
        momentum(
            model.sizes,
            model.constants,
            model.loads,
            model.work,
            model.sets,
            model.bodies,
            motion[0],
            motion[1],
            motion[2],
            model.state,
            model.acceleration,
            model.columns,
        )
    for row in range(model.columns.shape[0]):
        for j in range(joints):
            x[to + row * joints + j] = model.columns[row, j]


@inner
def remember(program: LawProgram) -> None:
    """Let the memory after the step be that of the next one."""
    for k in range(program.after.shape[0]):
        program.kept[k] = program.numbers[program.after[k]]
    for k in range(program.after.shape[0]):
        program.numbers[program.memory[k]] = program.kept[k]
