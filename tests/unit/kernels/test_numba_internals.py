"""The package computes with a version of Numba that lacks one of the private names it uses.

Names that Numba needs itself, such as ``infer_global``, cannot be removed here.
"""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.compiled

#: Statements that remove a private name, as another version of Numba might.
REMOVED = {
    "event": "import numba.core; del numba.core.event; sys.modules['numba.core.event'] = None",
    "cache": "import numba.core.caching as module; del module._Cache",
    "reduce": "from numba.core.compiler import CompileResult; del CompileResult._reduce",
    "convert": "import numba.core.typeconv.castgraph as module; del module.Conversion",
    "link": "from numba.core.codegen import JITCodeLibrary as library\n"
    "linked = library._get_module_for_linking\n"
    "library._get_module_for_linking = lambda self: linked(self)",
}
#: Kernels like those of the package.
PROGRAM = """
import json, sys
import numba
{removed}
import numpy as np
import flexarm as fa
from flexarm.kernels.compilation import numba_internals as internals
from flexarm.kernels.compilation.cache import apart, compiled

@apart
def half(x):
    return 0.5 * x

@compiled
def quarter(x):
    return 0.5 * half(x)

flags = [internals.CAN_SAVE, internals.CAN_LINK, internals.HAS_NUMBER_TYPES]
print(json.dumps([quarter(4.0), *flags]))
"""
SAVE, LINK, TYPES = 1, 2, 3
LOST = {"reduce": SAVE, "convert": TYPES, "link": LINK}


@pytest.mark.sampled("link")
@pytest.mark.parametrize("name", REMOVED)
def test_kernels_compile_without_a_private_name(tmp_path, name):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM.format(removed=REMOVED[name]), encoding="utf-8")
    environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path), "NUMBA_DISABLE_JIT": "0"}
    done = subprocess.run(
        [sys.executable, str(program)], env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer[0] == 1.0
    missing = [k for k in (SAVE, LINK, TYPES) if not answer[k]]
    assert missing == ([LOST[name]] if name in LOST else [])


@pytest.mark.thorough
def test_runs_do_not_need_packs_and_dual_numbers(tmp_path):
    program = tmp_path / "program.py"
    text = PROGRAM.format(removed=REMOVED["convert"])
    program.write_text(
        text + "arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=100.0, "
        "mass_per_length=0.5)] * 2)\n"
        "batch = fa.simulate_batch(arm, 0.1, initial=np.zeros((2, arm.dof)), progress=False)\n"
        "print(json.dumps([batch.sizes['run']]))\n",
        encoding="utf-8",
    )
    done = subprocess.run(
        [sys.executable, str(program)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[1]) == [2]
