"""Files of machine code that were exchanged: no kernel runs the code of another one."""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.compiled

# Two kernels with the same bytecode and argument types, which differ in a constant.
PAIR = """
from flexarm.kernels.compilation.cache import compiled
@compiled
def double(x):
    return 2.0 * x
@compiled
def triple(x):
    return 3.0 * x
"""
EXCHANGED = """
import json, shutil
from pathlib import Path
from flexarm.kernels.compilation import cache, code_cache, private_folder
import pair

folder = private_folder.cache_folder()
first = [pair.double(1.5), pair.triple(1.5)]
double, triple = (next(folder.glob(f"pair.{name}-*.code")) for name in ("double", "triple"))
contents = triple.read_bytes(), double.read_bytes()

def called():
    kernels = [cache.compiled(kernel.py_func) for kernel in (pair.double, pair.triple)]
    return [[kernel(1.5), sum(kernel.dispatcher.stats.cache_hits.values())] for kernel in kernels]

usual = called()
double.write_bytes(contents[0])
triple.write_bytes(contents[1])
exchanged, again = called(), called()
# The same files in a folder of other sources.
other = Path(shutil.copytree(folder, folder.with_name("kernels-other")))
kept = code_cache.CodeCache(pair.double.py_func, other, True)
moved = kept.load_overload(pair.double.dispatcher.signatures[0], pair.double.dispatcher.targetctx)
print(json.dumps([first, usual, exchanged, again, moved is None]))
"""


@pytest.mark.thorough
def test_exchanged_files_are_compiled_again(tmp_path):
    (tmp_path / "pair.py").write_text(PAIR, encoding="utf-8")
    places = {"PYTHONPATH": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", EXCHANGED],
        env={**os.environ, **places, "NUMBA_DISABLE_JIT": "0"},
        capture_output=True,
        text=True,
        check=True,
    )
    first, usual, exchanged, again, refused = json.loads(done.stdout)
    assert first == [3.0, 4.5]
    assert usual == again == [[3.0, 1], [4.5, 1]]
    assert exchanged == [[3.0, 0], [4.5, 0]]
    assert refused
