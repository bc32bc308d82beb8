"""One kind of wrong value in every argument that takes its right kind: paths, names, functions.

`test_calls.py` draws arguments and values at random; here every pair is tried.
"""

from __future__ import annotations

import gc
import os
import re
import warnings
from functools import cache
from pathlib import Path

import pytest

import flexarm as fa
from fuzz.call_cases import check_message
from fuzz.public_calls import calls, parameters
from fuzz.wrong_values import WRONG

CALLS = calls()
#: Calls whose arguments are tried: those that are quick to make, of every converter.
OF_PATHS = "load_|save_|read_|write_|export_|Separation.save|Identification.write|Study.verify"
OF_NAMES = "SlidingMode$|compare$|goal_gradient|simulate$|simulate_batch$|varied|Adaptive$"
OF_MOTIONS = "[a-z].*_motion$"


@cache
def pairs(pattern, fits):
    """Return the names of calls, and of their arguments, whose valid values fit."""
    found = []
    for name in filter(re.compile(pattern).match, sorted(CALLS)):
        function, valid = CALLS[name]()
        found += [(name, one) for one in parameters(name, function) if fits(one, valid.get(one))]
    return found


def is_path(name, value):
    return re.search("path|store|folder", name) is not None and isinstance(value, str | Path)


def is_mapping(name, value):
    return isinstance(value, dict)


def is_float(name, value):
    return isinstance(value, float)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def check(name, argument, make):
    """Make a call with one wrong value; only a result or an error of flexarm is allowed."""
    function, valid = CALLS[name]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            function(**(valid | {argument: make(valid[argument])}))
        except fa.FlexarmError as error:
            check_message(error)
        except Exception as error:
            error.add_note(f"{name}, {argument}")
            raise


def below_a_file(suffix):
    Path("file").touch()
    return f"file/a{suffix}"


def folder(suffix):
    Path(f"folder{suffix}").mkdir(exist_ok=True)
    return f"folder{suffix}"


def link_to_itself(suffix):
    if not os.path.lexists(f"link{suffix}"):
        os.symlink(f"link{suffix}", f"link{suffix}")
    return f"link{suffix}"


PATHS = {
    "long name": lambda suffix: "x" * 300 + suffix,
    "long folder": lambda suffix: f"{'x' * 300}/a{suffix}",
    "long name of three bytes a letter": lambda suffix: "\u221e" * 100 + suffix,
    "long path": lambda suffix: "x/" * 3000 + f"a{suffix}",
    "null": lambda suffix: f"a\0b{suffix}",
    "half of a pair": lambda suffix: f"a\ud800{suffix}",
    "bytes": lambda suffix: f"a{suffix}".encode(),
    "nothing": lambda suffix: Path(suffix),
    "below a file": below_a_file,
    "folder": folder,
    "link to itself": link_to_itself,
    "missing folder": lambda suffix: f"/nowhere/at/all{suffix}",
}


@pytest.mark.sampled("null", "nothing")
@pytest.mark.parametrize("kind", PATHS)
def test_every_path_argument_names_a_path_that_cannot_be_used(kind):
    arguments = pairs(OF_PATHS, is_path)
    assert len(arguments) > 15
    for name, argument in arguments:
        check(name, argument, lambda path: PATHS[kind](Path(path).suffix))


@pytest.mark.parametrize("key", [None, 1.5, (1, 2), "a\x1bb"])
def test_every_mapping_names_a_key_that_is_not_a_name(key):
    arguments = pairs(OF_NAMES, is_mapping)
    assert len(arguments) > 3
    for name, argument in arguments:
        check(name, argument, lambda valid: {**valid, key: next(iter(valid.values()), 1.0)})
        check(name, argument, lambda valid: {key: (0.1, 0.2)})


def test_a_mapping_without_text_as_names_is_refused():
    """The key None once counted as absent."""
    function, valid = CALLS["SlidingMode"]()
    with pytest.raises(fa.InputError, match="uncertainty must have text as names, got"):
        function(**(valid | {"uncertainty": {None: (0.1, 0.2)}}))


def two_links():
    return fa.Arm(links=[fa.Link(length=0.5, flexural_rigidity=5.0, mass_per_length=0.3)] * 2)


#: Calls with a function of time.
OF_TIME = {
    "torque": lambda arm, f: fa.simulate(arm, 0.02, torque=f),
    "base acceleration": lambda arm, f: fa.simulate(arm, 0.02, base_acceleration=f),
    "factor": lambda arm, f: fa.simulate(arm, 0.02, loads=[fa.Load(1, (0.0, 1.0), factor=f)]),
    "course": lambda arm, f: fa.simulate(
        arm, 0.02, changes=[fa.Change("payload.mass", at=0.01, to=f)]
    ),
    "feedforward": lambda arm, f: fa.simulate(
        arm, 0.02, controller=fa.JointPD([1.0, 1.0], [0.1, 0.1], 0.01, f)
    ),
    "prescribed": lambda arm, f: fa.simulate(
        arm, 0.02, prescribed={1: fa.PrescribedAngle(f, f, f)}
    ),
    "event": lambda arm, f: fa.simulate(arm, 0.02, events=[fa.Event(f)]),
    "derivatives": lambda arm, f: fa.sensitivities(
        arm, 0.02, parameters=["links[0].flexural_rigidity"], base_acceleration=f
    ),
    "batch": lambda arm, f: fa.simulate_batch(arm, 0.02, torque=[f, f]),
}


@pytest.mark.sampled("torque-asynchronous function", "prescribed-object with an asynchronous call")
@pytest.mark.filterwarnings("ignore:coroutine .* was never awaited")
@pytest.mark.parametrize(
    "kind", ["asynchronous function", "generator function", "object with an asynchronous call"]
)
@pytest.mark.parametrize("place", OF_TIME)
def test_functions_of_time_that_return_no_value_are_named(place, kind):
    with pytest.raises(fa.FlexarmError) as error:
        OF_TIME[place](two_links(), WRONG[kind]())
    check_message(error.value)
    del error
    gc.collect()  # coroutines in its traceback, whose warning is ignored here alone


@pytest.mark.parametrize("huge", [1e200, -1e308, 10**400])
def test_every_motion_names_a_huge_number(huge):
    motions = pairs(OF_MOTIONS, is_float)
    assert len(motions) > 5
    for name, argument in motions:
        check(name, argument, lambda _: huge)


def test_a_circle_of_huge_angle_is_refused():
    with pytest.raises(fa.InputError, match="circle_motion: the arguments contain a number that"):
        fa.circle_motion(two_links(), (0.5, 0.2), (0.6, 0.2), 1e200, 1.0)
