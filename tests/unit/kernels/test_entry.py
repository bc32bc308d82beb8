"""Cached entry points of kernels: equal results, and compilation for new types."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest

import flexarm as fa
from flexarm.kernels.compilation.cache import Entry, compiled
from flexarm.kernels.layout import new_workspace, no_loads, run_time_sizes
from flexarm.kernels.recursion.newton_euler import inverse_dynamics


def arguments(arm):
    """Return all arguments of the inverse dynamics of an arm in motion."""
    constants = arm.assembly.constants
    n, m = constants.S.shape
    state = np.random.default_rng(1).normal(size=(2, n, 1 + m))
    loads, work = no_loads(constants), new_workspace(constants)
    return run_time_sizes(constants), constants, state, np.ones((n, 1 + m)), loads, work


def arm_of(links):
    link = fa.Link(length=1.0, flexural_rigidity=5.0, mass_per_length=0.3, elements=2)
    return fa.Arm(links=[link] * links, gravity=(0.0, -9.81))


@pytest.mark.compiled
def test_entry_returns_the_result_of_the_kernel():
    given = arguments(arm_of(2))
    inverse_dynamics(*given)
    expected = given[-1].force.copy()
    entry = Entry(inverse_dynamics)
    for _ in range(3):  # the last calls use the words of the first
        given[-1].force[:] = 0.0
        entry(*given)
        np.testing.assert_array_equal(given[-1].force, expected)


@compiled
def doubled(given, out):
    """Double the numbers of an array; it compiles fast, for each type."""
    for i in range(given.size):
        out[i] = 2.0 * given[i]


@compiled
def scaled(pair, out, power):
    """Scale the array of a pair by its number, several times."""
    for i in range(out.size):
        out[i] = pair[0][i] * pair[1] ** power


@pytest.mark.compiled
def test_another_type_of_the_first_argument_is_compiled():
    entry = Entry(doubled)
    line, other, turned = np.array([1.0, 2.0]), np.array([3.0]), np.array([1.0 + 2.0j])
    for given in (line, other, turned, line):
        out = np.zeros_like(given)
        for _ in range(3):
            out[:] = 0.0
            entry(given, out)
            np.testing.assert_array_equal(out, 2.0 * given)


@pytest.mark.compiled
def test_changed_arguments_are_noticed():
    entry, out = Entry(doubled), np.zeros(2)
    line = np.array([1.0, 2.0])
    for given in (line, line[::-1], np.array([5.0, 7.0]), np.array([1.0])):
        out[:] = 0.0
        entry(given, out)
        np.testing.assert_array_equal(out[: given.size], 2.0 * given)
    more = np.zeros(3)
    entry(np.ones(3), more)
    np.testing.assert_array_equal(more, 2.0)
    np.testing.assert_array_equal(out, [2.0, 0.0])


@pytest.mark.compiled
def test_numbers_in_records_are_noticed():
    """A record with other numbers is another object; the array stays the same."""
    entry, out = Entry(scaled), np.zeros(2)
    for factor in (2.0, 3.0, 3.0):
        entry((np.array([1.0, 2.0]), factor), out, 1)
        np.testing.assert_array_equal(out, [factor, 2.0 * factor])
    entry((np.array([1.0, 2.0]), 2.0), out, 2)
    np.testing.assert_array_equal(out, [4.0, 8.0])


@pytest.mark.compiled
def test_entry_after_an_error_starts_again():
    """Words of arguments that no longer exist must never be used."""
    entry, out = Entry(scaled), np.zeros(2)
    entry((np.array([1.0, 2.0]), 2.0), out, 1)
    for wrong in ("a text", 2**70):
        with pytest.raises(Exception, match=r".+"):
            entry((np.array([1.0, 2.0]), 2.0), out, wrong)
        with pytest.raises(Exception, match=r".+"):
            entry((np.array([1.0, 2.0]), 2.0), out, wrong)
    entry((np.array([1.0, 2.0]), 3.0), out, 1)
    np.testing.assert_array_equal(out, [3.0, 6.0])


def test_copies_and_pickles_have_their_own_entry_points():
    entry = Entry(inverse_dynamics)
    given = arguments(arm_of(2))
    for _ in range(3):
        entry(*given)
    expected = given[-1].force.copy()
    for copied in (copy.deepcopy(entry), pickle.loads(pickle.dumps(entry))):
        given[-1].force[:] = 0.0
        copied(*given)
        np.testing.assert_array_equal(given[-1].force, expected)


@pytest.mark.thorough
def test_without_a_compiler_the_entry_is_the_function():
    program = (
        "from flexarm.kernels.compilation.cache import Entry, compiled\n"
        "@compiled\n"
        "def double(x):\n"
        "    return 2.0 * x\n"
        "print(Entry(double)(1.5))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program],
        env={"NUMBA_DISABLE_JIT": "1", "PATH": ""} | _paths(),
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.stdout.strip() == "3.0", ran.stderr


def _paths():
    return {"PYTHONPATH": ":".join(path for path in sys.path if path)}
