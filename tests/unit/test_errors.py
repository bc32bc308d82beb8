"""The format of problems, and the checks of arrays."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from flexarm.base.errors import (
    FlexarmError,
    InputError,
    ModelError,
    Problem,
    SimulationError,
    check_array,
    shown,
)


def test_problem_reads_as_a_sentence():
    problem = Problem("length", "be greater than 0", "-1")
    assert str(problem) == "length must be greater than 0, got -1."
    problem = replace(problem, where="arm.yaml:5")
    assert str(problem) == "arm.yaml:5: length must be greater than 0, got -1."
    assert str(Problem("q", "be finite", "0, 1, ...")) == "q must be finite, got 0, 1, ..."
    with_hint = Problem("theory", "be one of 'a', 'b'", "'c'", "Did you mean 'b'?")
    assert str(with_hint).endswith("got 'c'. Did you mean 'b'?")


def test_input_error_has_one_line_per_problem_up_to_fifty():
    problems = [Problem(f"x[{i}]", "be finite", "nan") for i in range(52)]
    assert str(InputError(*problems[:2])) == (
        "x[0] must be finite, got nan.\nx[1] must be finite, got nan."
    )
    error = InputError(*problems)
    assert len(error.problems) == 52
    assert str(error).splitlines()[50:] == ["... and 2 more problems."]


def test_errors_have_builtin_base_classes_and_can_be_pickled():
    assert issubclass(ModelError, InputError)
    assert issubclass(InputError, ValueError)
    assert issubclass(SimulationError, RuntimeError)
    assert issubclass(SimulationError, FlexarmError)
    error = ModelError(Problem("x", "be finite", "nan"))
    assert pickle.loads(pickle.dumps(error)).problems == error.problems
    failure = pickle.loads(pickle.dumps(SimulationError(0.5, "It diverged.", "Try less.")))
    assert str(failure) == "stopped at t = 0.5 s: It diverged. Try less."
    assert (failure.time, failure.state, failure.result) == (0.5, None, None)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "nothing"),
        (1.0, "1"),
        (0.1 + 0.2, "0.30000000000000004"),
        (np.float64(2.5), "2.5"),
        (True, "True"),
        ([1.0, [2, 3]], "[1, [2, 3]]"),
        (list(range(9)), "[0, 1, 2, 3, ...]"),
        ("a\nb", r"'a\nb'"),
    ],
)
def test_values_are_shown_on_one_short_line(value, text):
    assert shown(value) == text


@pytest.mark.parametrize("value", ["x" * 1000, 10**500, np.zeros((50, 50)), {"k": ["v" * 90] * 90}])
def test_long_values_are_shortened(value):
    assert len(shown(value)) < 400
    assert "\n" not in shown(value)


def test_check_array_returns_a_float_copy():
    given = np.array([1.0, 2.0, 3.0])
    array = check_array("x", given, (3,))
    assert array.dtype == np.float64
    given[0] = 9
    assert array.tolist() == [1.0, 2.0, 3.0]
    assert check_array("x", [[1, 2]], (-1, 2)).shape == (1, 2)
    assert check_array("x", 2, ()) == 2.0
