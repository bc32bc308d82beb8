"""Every public callable and method has a base call, which works; wrong values in figures.

`call_cases.py` passes wrong values to all of them.
"""

from __future__ import annotations

import os
import warnings

import pytest

import flexarm as fa
from fuzz.base_calls import MADE_BY_FLEXARM
from fuzz.call_cases import CALLS, check_call
from fuzz.figure_calls import FIGURES
from fuzz.public_calls import methods_without_a_call, public_names
from fuzz.wrong_values import WRONG


@pytest.fixture(autouse=True, scope="module")
def _somewhere_else(tmp_path_factory):
    """Work in an empty folder, because a text in place of a path is the name of an output file."""
    before = os.getcwd()
    os.chdir(tmp_path_factory.mktemp("calls"))
    yield
    os.chdir(before)


def test_every_public_callable_has_a_base_call():
    lacking = sorted(set(public_names()) - set(CALLS))
    assert not lacking, "add valid arguments to tests/fuzz/base_calls.py"


def test_objects_that_flexarm_returns_are_public():
    assert set(fa.__all__) >= MADE_BY_FLEXARM


@pytest.mark.thorough_cases(
    "write_result", "Study.rare_failures", "optimal_motion", "design", "export_c", "export_fmu"
)
@pytest.mark.parametrize("name", sorted(CALLS))
def test_base_calls_are_accepted(name):
    if name.startswith("to_jax"):
        pytest.importorskip("jax", reason="JAX is not installed: fa.to_jax was not tried")
    if name.startswith("MuSynthesis"):
        pytest.importorskip(
            "slycot", reason="it comes with the extra: pip install 'flexarm[robust]'"
        )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of links that bend far, and of optional packages
        function, arguments = CALLS[name]()
        returned = function(**arguments)
        missing = methods_without_a_call(name, returned)
    assert not missing, f"{name} returns a {type(returned).__name__} with methods without base call"


@pytest.mark.parametrize(
    ("name", "argument", "value"),
    [
        ("IntegralResonantControl.strain_correction", "t", "empty array"),
        ("PositivePositionFeedback.strain_correction", "t", "empty array"),
        ("Arm.motor_torque", "voltage", "object array of objects"),
        ("SampledModel.frequency_response", "omega", "zero"),
        ("MotionLimits", "joint_angle", "0-d array"),
    ],
)
def test_defects_that_were_found_at_random(name, argument, value):
    """Each raised an exception that was no error of flexarm."""
    check_call(name, {argument: value})


@pytest.mark.sampled(
    "plot.bending_moment-result",
    "plot.compare-channels",
    "plot.history-channels",
    "plot.phase_portrait-channel",
    "plot.response_figure-omega",
    "plot.tracks_figure-tracks",
)
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
