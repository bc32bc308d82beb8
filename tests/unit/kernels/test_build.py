"""A library of kernels that are not of the package: exported, linked, loaded and called."""

import json
import os
import platform
import re
import shutil
import subprocess
import sys

import pytest

pytestmark = pytest.mark.compiled

KERNELS = """
from typing import NamedTuple
import numpy as np
from flexarm.kernels.compilation.cache import apart, compiled, unlocked

class Pair(NamedTuple):
    matrix: np.ndarray
    factor: float

@apart
def half(x):
    return 0.5 * x

@compiled
def filled(pair, out, more):
    total = 0.0
    for i in range(pair.matrix.shape[0]):
        for j in range(pair.matrix.shape[1]):
            out[i] += half(pair.factor * pair.matrix[i, j])
            total += pair.matrix[i, j]
    return total if more else -total

@unlocked
def counted(array, least):
    count = 0
    for x in array.flat:
        if x.real > least:
            count += 1
    return count

@compiled
def inverse(z, out):
    out[0] = 1.0 / z[0]

@compiled
def is_negative(x):
    return x < 0.0
"""
PROGRAM = """
import json, sys
from pathlib import Path
import numpy as np
import own
from flexarm.kernels.compilation import build, library
from flexarm.kernels.compilation.cache import Entry

def results():
    out = np.zeros(2)
    matrix = np.arange(6.0).reshape(2, 3)
    wide = np.arange(12.0).reshape(2, 6)[:, ::2]
    return [
        own.filled(own.Pair(matrix, 2.0), out, True), out.tolist(),
        own.filled(own.Pair(wide, 2.0), out, False), out.tolist(),
        own.counted(np.array([1.0 + 1.0j, 3.0]), 2), own.is_negative(-1.0), own.is_negative(2.0),
        *inverses(),
    ]

def inverses():
    z, out = np.array([2.0 + 0.0j]), np.zeros(1, dtype=complex)
    own.inverse(z, out)
    z[0] = 0.0
    try:
        own.inverse(z, out)
    except ZeroDivisionError as error:
        return [out[0].real, str(error)]
    return [out[0].real, "no error"]

folder, every = Path(sys.argv[1]), sys.argv[2] == "every"
build.record(folder)
expected = results()
build.export(folder / "objects", every)
files = build.link(folder / "objects", folder / "linked", every)
known = library.Library(folder / "linked")
for kernel in (own.filled, own.counted, own.is_negative, own.inverse):
    kernel._codes.clear()
library.loaded = lambda: known
from flexarm.kernels.compilation import cache
cache._compiler = None  # the library has all
print(json.dumps([expected, results(), [str(file) for file in files]]))
"""


def built(folder, every):
    """Return results before and after a library of kernels is built, and its files."""
    (folder / "own.py").write_text(KERNELS, encoding="utf-8")
    (folder / "objects").mkdir()
    places = {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(folder), every],
        env={**os.environ, **places, "FLEXARM_KERNELS": "compile"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


needs_compiler = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler: cc")


@needs_compiler
def test_built_kernels_return_what_compiled_ones_return(tmp_path):
    expected, answers, files = built(tmp_path, "this")
    assert expected[0] == 15.0
    assert expected[1] == [3.0, 12.0]
    assert expected[4:] == [1, True, False, 0.5, "complex division by zero"]
    assert answers == expected
    assert len(files) == 1


@needs_compiler
@pytest.mark.skipif(platform.machine() != "x86_64", reason="this family has one level")
@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm of the binutils")
def test_library_for_every_processor_refers_to_functions_of_mathematics_alone(tmp_path):
    expected, answers, files = built(tmp_path, "every")
    assert answers == expected
    assert [re.search(r"-(v\d)\.so$", file)[1] for file in files] == ["v4", "v3", "v1"]
    for file in files:
        listed = subprocess.run(
            ["nm", "-D", "--undefined-only", file], capture_output=True, text=True
        )
        assert listed.stdout.split() == []
