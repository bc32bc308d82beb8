"""Wrong values in every public callable: one error that names the argument, or a result.

`FUZZ_EXAMPLES` sets the number of calls: a few in every test run, tens of thousands in `make fuzz`.
"""

from __future__ import annotations

import os
import sys
import warnings

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import flexarm as fa
from fuzz.base_calls import MADE_BY_FLEXARM
from fuzz.figure_calls import FIGURES
from fuzz.public_calls import calls, parameters, public_names
from fuzz.wrong_values import WRONG

CALLS = calls()
#: Calls in one test; a few hundred include every kind of argument.
EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "200"))


@pytest.fixture(autouse=True, scope="module")
def _somewhere_else(tmp_path_factory):
    """Work in an empty folder, because a text in place of a path is the name of an output file."""
    before = os.getcwd()
    os.chdir(tmp_path_factory.mktemp("calls"))
    yield
    os.chdir(before)


@pytest.mark.parametrize("name", sorted(set(public_names())))
def test_every_public_callable_has_a_base_call(name):
    assert name in CALLS, f"add valid arguments of {name} to tests/fuzz/base_calls.py"


def test_objects_that_flexarm_returns_are_public():
    assert set(fa.__all__) >= MADE_BY_FLEXARM


@pytest.mark.parametrize("name", sorted(CALLS))
def test_base_calls_are_accepted(name):
    if name == "to_jax":
        pytest.importorskip("jax", reason="JAX is not installed: fa.to_jax was not tried")
    if name.startswith("MuSynthesis"):
        pytest.importorskip(
            "slycot", reason="it comes with the extra: pip install 'flexarm[robust]'"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of links that bend far, and of optional packages
        function, arguments = CALLS[name]()
        function(**arguments)


@st.composite
def wrong_calls(draw):
    """Draw a call, one or two of its arguments, and a wrong value for each."""
    name = draw(st.sampled_from(sorted(CALLS)))
    function, _ = CALLS[name]()
    names = parameters(name, function)
    some = st.lists(st.sampled_from(names), min_size=1, max_size=2, unique=True)
    chosen = draw(some) if names else []
    return name, {one: draw(st.sampled_from(sorted(WRONG))) for one in chosen}


def check_call(name: str, wrong: dict[str, str]) -> None:
    """Make a call with wrong values; only a result or an error of flexarm is allowed."""
    function, arguments = CALLS[name]()
    arguments |= {argument: WRONG[value]() for argument, value in wrong.items()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
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


@settings(
    max_examples=EXAMPLES,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(call=wrong_calls())
def test_wrong_values_raise_errors_that_name_them(call):
    name, wrong = call
    check_call(name, wrong)


@pytest.mark.parametrize(
    ("name", "argument"),
    [
        (f"plot.{name}", argument)
        for name, arguments in FIGURES.items()
        for argument in [*arguments, "axes"]
        if not (argument == "axes" and (name.endswith("_figure") or name == "styled"))
    ],
)
def test_figures_of_wrong_values_raise_errors_that_name_them(name, argument):
    for value in sorted(WRONG):
        try:
            check_call(name, {argument: value})
        except Exception as error:
            error.add_note(f"{argument}: {value}")
            raise
