"""The base calls and the conformance tests with the oldest and the newest dependencies."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from fuzz.farm import ROOT, Part

_TESTS = "TESTS=tests/fuzz tests/conformance"


def with_dependencies(rng: np.random.Generator, number: int) -> None:
    """Make an environment and run the tests in it, once for each kind of dependencies."""
    if number > 1:
        raise StopIteration
    kinds = (["test-lowest"], ["suite", "VENV=.venv-newest", "PIP_OPTIONS=--upgrade"])
    command = ["make", *kinds[number], f"PYTHON={sys.executable}", _TESTS]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-1500:]


PARTS = {
    "dependencies": Part(
        "the tests of all public calls and registries with the lowest versions of all "
        "dependencies, and with the newest",
        with_dependencies,
    ),
}
