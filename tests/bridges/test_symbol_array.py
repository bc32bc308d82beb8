"""Functions of NumPy over arrays of CasADi symbols, against the same over numbers."""

from copy import deepcopy

import casadi
import numpy as np
import pytest

from conformance.controller_examples import two_links
from flexarm.bridges.symbolic.kernel_calls import SymbolError, objects, plain
from flexarm.bridges.symbolic.symbol_array import SymbolArray, make_symbolic, symbol_array
from flexarm.control.design.rigid_model import TaskSpace

A = np.array([-1.2, -0.3, 0.0, 0.4, 2.5])
B = np.array([0.7, -0.3, 0.1, 0.4, -2.0])
MATRIX = np.arange(15.0).reshape(3, 5)


def in_place(a, b):
    kept = 1.0 * a
    kept -= b
    kept *= np.minimum(a, 0.5)
    return kept


FUNCTIONS = {
    "minimum": np.minimum,
    "maximum of a number": lambda a, b: np.maximum(a, -0.5) + b,
    "clip": lambda a, b: np.clip(a, -1.0, b),
    "less": lambda a, b: (a < b) * a,
    "less_equal": lambda a, b: (a <= b) * 1.0,
    "greater": lambda a, b: (a > b) * 1.0,
    "greater_equal": lambda a, b: (a >= b) * 1.0,
    "equal": lambda a, b: (a == b) * 1.0,
    "not_equal": lambda a, b: (a != b) * 1.0,
    "where": lambda a, b: np.where(a > 0.0, a, b) + np.where(MATRIX[0] > 2.0, a, 0.5),
    "or": lambda a, b: ((a == b) | (a > 1.0)) * 1.0,
    "and": lambda a, b: ((a == b) & (a > 0.0)) * 1.0,
    "absolute": lambda a, b: np.abs(a) - abs(b),
    "functions": lambda a, b: np.sin(a) + np.cos(b) + np.exp(a) + np.tanh(b) + np.sqrt(a * a),
    "with numbers among symbols": lambda a, b: np.tanh(np.where(MATRIX[0] > 2.0, 0.5, 0.1)) * a,
    "dot": lambda a, b: MATRIX.dot(a),
    "matmul": lambda a, b: MATRIX @ a + (a @ b),
    "sum": lambda a, b: np.sum(a * b, keepdims=True),
    "in place": in_place,
    "a comparison of one number": lambda a, b: (a @ b <= 0.0) * a,
}


@pytest.mark.parametrize("name", FUNCTIONS)
def test_function(name):
    function = FUNCTIONS[name]
    symbols = [casadi.SX.sym(key, len(A)) for key in "ab"]
    arrays = [symbol_array(objects(casadi.vertsplit(one), casadi)) for one in symbols]
    found = function(*arrays)
    assert isinstance(found, SymbolArray)
    outputs = casadi.vertcat(*(casadi.SX(plain(one)) for one in found))
    values = np.array(casadi.Function("f", symbols, [outputs])(A, B)).ravel()
    np.testing.assert_allclose(values, function(A, B), rtol=1e-15, atol=0)


def test_a_condition_on_a_symbol_is_an_error():
    symbols = symbol_array(objects(casadi.vertsplit(casadi.SX.sym("a", 2)), casadi))
    for wrong in (lambda: bool(symbols[0] > 0.0), lambda: float(symbols[0]), symbols.any):
        with pytest.raises(SymbolError, match="condition"):
            wrong()
    constant = symbols[0] - symbols[0]
    assert not constant < 0.0


def test_task_space_over_symbols():
    """Motion, Jacobian, mass, bias and torque of the tip, whose kernels use complex numbers."""
    task = TaskSpace(two_links())
    symbolic = deepcopy(task)
    make_symbolic(symbolic, ("flexarm.control.design",))
    symbols = [casadi.SX.sym(key, 2) for key in ("angle", "rate")]
    arrays = [symbol_array(objects(casadi.vertsplit(one), casadi)) for one in symbols]

    def outputs(space, angle, rate):
        state = space.at(angle, rate)
        torque = space.torque(state, (0.3, -0.2), (1.0, 2.0), 0.5 * angle, rate)
        return np.concatenate([*(one.ravel() for one in state), torque])

    column = casadi.vertcat(*(casadi.SX(plain(one)) for one in outputs(symbolic, *arrays)))
    values = ([0.4, -0.7], [1.1, 0.6])
    found = np.array(casadi.Function("f", symbols, [column])(*values)).ravel()
    wanted = outputs(task, *map(np.array, values))
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14 * np.abs(wanted).max())
