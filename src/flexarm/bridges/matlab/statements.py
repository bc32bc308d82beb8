"""Statements of MATLAB that compute a CasADi function of scalars.

CasADi has no generator for MATLAB code. Its functions of type SX are lists of elementary
operations on a work vector, which are written here one by one. The entries of the work vector are
variables, and the operators act on rows: a call evaluates many columns at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import casadi

#: Expressions of the operations in terms of their operands.
EXPRESSIONS = {
    casadi.OP_ASSIGN: "{0}",
    casadi.OP_ADD: "{0} + {1}",
    casadi.OP_SUB: "{0} - {1}",
    casadi.OP_MUL: "{0} .* {1}",
    casadi.OP_DIV: "{0} ./ {1}",
    casadi.OP_NEG: "-{0}",
    casadi.OP_INV: "1 ./ {0}",
    casadi.OP_SQ: "{0} .* {0}",
    casadi.OP_TWICE: "2 * {0}",
    casadi.OP_POW: "{0} .^ {1}",
    casadi.OP_CONSTPOW: "{0} .^ {1}",
    casadi.OP_SQRT: "sqrt({0})",
    casadi.OP_EXP: "exp({0})",
    casadi.OP_EXPM1: "expm1({0})",
    casadi.OP_LOG: "log({0})",
    casadi.OP_LOG1P: "log1p({0})",
    casadi.OP_SIN: "sin({0})",
    casadi.OP_COS: "cos({0})",
    casadi.OP_TAN: "tan({0})",
    casadi.OP_ATAN: "atan({0})",
    casadi.OP_ATAN2: "atan2({0}, {1})",
    casadi.OP_SINH: "sinh({0})",
    casadi.OP_COSH: "cosh({0})",
    casadi.OP_TANH: "tanh({0})",
    casadi.OP_FABS: "abs({0})",
    casadi.OP_SIGN: "sign({0})",
    casadi.OP_FMIN: "min({0}, {1})",
    casadi.OP_FMAX: "max({0}, {1})",
}


def statements(function: casadi.Function) -> Iterator[str]:
    """Yield the statements that compute the outputs of a function from its inputs.

    Inputs and outputs are arrays with the names of the function's, one column for each evaluation.
    The outputs exist already and are dense columns.

    Raises:
        NotImplementedError: if an operation has no expression; the kernels use none of these.
    """
    given, results = function.name_in(), function.name_out()
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        source, target = function.instruction_input(k), function.instruction_output(k)
        if operation == casadi.OP_OUTPUT:
            yield f"{results[target[0]]}({target[1] + 1}, :) = w{source[0]};"
            continue
        if operation == casadi.OP_CONST:
            value = repr(function.instruction_constant(k))
        elif operation == casadi.OP_INPUT:
            value = f"{given[source[0]]}({source[1] + 1}, :)"
        elif operation in EXPRESSIONS:
            value = EXPRESSIONS[operation].format(*(f"w{one}" for one in source))
        else:
            raise NotImplementedError(f"operation {operation} of CasADi in MATLAB")
        yield f"w{target[0]} = {value};"
