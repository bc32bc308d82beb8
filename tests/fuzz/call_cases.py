"""Wrong values in every public callable and method: an error of flexarm, or a result."""

from __future__ import annotations

import sys
from functools import partial

import numpy as np

import flexarm as fa
from fuzz.farm import Part
from fuzz.public_calls import calls, parameters
from fuzz.wrong_values import WRONG

CALLS = calls()
#: Parts, so that each reaches all of its callables several times in ten minutes.
_PARTS = 4


def check_call(name: str, wrong: dict[str, str]) -> None:
    """Make a call with wrong values; only a result or an error of flexarm is allowed."""
    function, arguments = CALLS[name]()
    arguments |= {argument: WRONG[value]() for argument, value in wrong.items()}
    try:
        function(**arguments)
    except fa.FlexarmError as error:
        check_message(error)
    finally:
        if (pyplot := sys.modules.get("matplotlib.pyplot")) is not None:
            pyplot.close("all")  # thousands of open figures would use all memory


def check_message(error: fa.FlexarmError) -> None:
    """Check that every problem is one line of moderate length with a place and an argument."""
    for problem in getattr(error, "problems", [error]):
        text = str(problem)
        assert text.strip(), error
        assert "\n" not in text, text
        assert len(text) < 1500, text
        assert getattr(problem, "name", "given"), text
        assert getattr(problem, "where", "given"), text  # `public_call` is missing


def wrong_call(part: int, rng: np.random.Generator, number: int) -> None:
    """Make a call of the part, in turn, with one or two wrong values."""
    name = sorted(CALLS)[part::_PARTS][number % len(sorted(CALLS)[part::_PARTS])]
    names = parameters(name, CALLS[name]()[0])
    count = min(len(names), int(rng.integers(1, 3)))
    chosen = rng.choice(sorted(names), count, replace=False) if names else []
    wrong = {str(argument): str(rng.choice(sorted(WRONG))) for argument in chosen}
    try:
        check_call(name, wrong)
    except Exception as error:
        error.add_note(f"{name}({wrong})")
        raise


_MEANING = (
    "public callables and methods, one in four, each with one or two wrong values: a result, or an "
    "error of flexarm that names the argument"
)
_MEANINGS = [_MEANING] + ["another quarter of these"] * (_PARTS - 1)
PARTS = {f"calls-{k + 1}": Part(_MEANINGS[k], partial(wrong_call, k)) for k in range(_PARTS)}
