"""Machine code of a kernel exists once, and callers loaded from disk find it."""

import json
import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.compiled

# Kernels of a user. The code of the callers, in another file, is kept if this file changes.
HALF = """
from flexarm.kernels.compilation.cache import compiled

@compiled
def half(x):
    return 0.5 * x
"""
CALLERS = """
from flexarm.kernels.compilation.cache import apart, compiled, inner, merged
from half import half

@inner
def same(x):
    return 1.0 * x

@apart
def double(x):
    return 2.0 * x

@merged
def quarter(x):
    return 0.5 * half(same(x))

@compiled
def fourth(x):
    return 0.5 * quarter(double(x))
"""
KERNELS = ("half", "same", "double", "quarter", "fourth")
CALL = f"""
import json, sys
import callers
KERNELS = {KERNELS}
if "half first" in sys.argv:
    callers.half(1.0)
value = callers.fourth(12.0)
answer = {{"value": value, "misses": [], "defined": {{}}, "referred": {{}}}}
for name in KERNELS:
    kernel = getattr(callers, name)
    if kernel.dispatcher.stats.cache_misses:
        answer["misses"].append(name)
    for version in kernel.dispatcher.overloads.values():
        code = list(version.library._final_module.functions)
        for kind, declared in (("defined", False), ("referred", True)):
            names = [one.name for one in code if bool(one.is_declaration) is declared]
            answer[kind][name] = [k for k in KERNELS if any(k + "B" in one for one in names)]
print(json.dumps(answer))
"""


@pytest.fixture
def call(tmp_path):
    """Return a function that runs the kernels in a separate process, with one cache for all
    calls."""
    (tmp_path / "half.py").write_text(HALF, encoding="utf-8")
    (tmp_path / "callers.py").write_text(CALLERS, encoding="utf-8")
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]),
        "PYTHONDONTWRITEBYTECODE": "1",
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "NUMBA_DISABLE_JIT": "0",
    }

    def run(*arguments):
        command = [sys.executable, "-c", CALL, *arguments]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    return run


def code_files(tmp_path, name):
    return list(tmp_path.glob(f"cache/flexarm/kernels-*/*.{name}-*.code"))


@pytest.mark.thorough
def test_machine_code_exists_once_and_callers_refer_to_it(call):
    fresh = call()
    assert fresh["value"] == 3.0
    assert sorted(fresh["misses"]) == sorted(KERNELS)
    assert fresh["defined"]["quarter"] == []  # merged: only as a part of its caller
    assert fresh["defined"]["half"] == ["half"]
    assert fresh["defined"]["fourth"] == ["fourth"]
    assert fresh["referred"]["fourth"] == ["half", "double"]


@pytest.mark.thorough
def test_caller_from_disk_finds_code_of_another_process(call, tmp_path):
    assert call()["value"] == 3.0
    assert call()["misses"] == []
    (code,) = code_files(tmp_path, "half")
    code.unlink()
    # If the kernel is compiled separately, its symbol differs from that to which its callers refer.
    again = call("half first")
    assert again["value"] == 3.0
    assert again["misses"] == ["half"]
    last = call()
    assert last["value"] == 3.0
    assert last["misses"] == []


@pytest.mark.thorough
def test_caller_is_compiled_again_if_the_result_has_another_type(call, tmp_path):
    assert call()["value"] == 3.0
    changed = HALF.replace("0.5 * x", "int(x) // 2")
    (tmp_path / "half.py").write_text(changed, encoding="utf-8")
    again = call()
    assert again["value"] == 3.0
    assert sorted(again["misses"]) == ["fourth", "half", "quarter"]


USER = """
import numba
from half import half

@numba.njit(cache=True)
def more(x):
    return half(x) + 1.0

print(more(4.0))
"""


@pytest.mark.thorough
def test_cached_function_of_a_user_finds_the_kernel_in_a_later_process(tmp_path):
    """Numba's own cache does not keep it, because it would not load the kernel before it."""
    (tmp_path / "half.py").write_text(HALF)
    (tmp_path / "user.py").write_text(USER)
    settings = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONWARNINGS": "ignore"}
    for _ in range(2):
        ended = subprocess.run(
            [sys.executable, "user.py"],
            cwd=tmp_path,
            env={**os.environ, **settings},
            capture_output=True,
            text=True,
            check=False,
        )
        assert (ended.returncode, ended.stdout.strip()) == (0, "3.0"), ended.stderr


VECTORS = """
import sys
import numba, numpy as np
from flexarm.kernels.compilation.cache import compiled

def scaled(x, y):
    for i in range(x.shape[0]):
        y[i] = 2.0 * x[i]

for decorate in (compiled, numba.njit):
    loop = decorate(scaled)
    loop(np.ones(9), np.zeros(9))
    (version,) = getattr(loop, "dispatcher", loop).overloads.values()
    print("x double>" in version.library.get_llvm_str())
"""


def test_kernels_have_no_vector_loops_and_functions_of_users_have(tmp_path):
    """A vector loop over three or four modes takes more time than it saves."""
    (tmp_path / "vectors.py").write_text(VECTORS)
    ended = subprocess.run(
        [sys.executable, "vectors.py"],
        cwd=tmp_path,
        env={**os.environ, "XDG_CACHE_HOME": str(tmp_path / "cache"), "NUMBA_DISABLE_JIT": "0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stdout.split()) == (0, ["False", "True"]), ended.stderr


IN_A_COMPILATION = """
import gc, os, sys, threading
from numba.core import event
from numba.core.types.functions import BaseFunction
from flexarm.kernels.compilation.cache import compiled

before = BaseFunction.get_call_type
compiling, forked = threading.Event(), threading.Event()

def state():
    return gc.isenabled(), BaseFunction.get_call_type is before

class Pause(event.Listener):
    def on_start(self, occurrence):
        if not compiling.is_set():
            print("during", *state(), flush=True)
            compiling.set()
            if "interrupt" in sys.argv:
                raise KeyboardInterrupt
            forked.wait(60.0)

    def on_end(self, occurrence):
        pass

@compiled
def half(x):
    return 0.5 * x

event.register("numba:run_pass", Pause())
if "interrupt" in sys.argv:
    try:
        half(4.0)
    except KeyboardInterrupt:
        print("after", *state())
    sys.exit()
thread = threading.Thread(target=half, args=(4.0,))
thread.start()
assert compiling.wait(60.0)
child = os.fork()
if child == 0:
    print("child", *state(), flush=True)
    os._exit(0)
os.waitpid(child, 0)
forked.set()
thread.join()
print("after", *state(), half(4.0))
"""


def states_of_a_compilation(tmp_path, *arguments):
    """Return the output lines of a process that compiles: garbage collection, and Numba's
    function."""
    program = tmp_path / "program.py"
    program.write_text(IN_A_COMPILATION, encoding="utf-8")
    settings = {"XDG_CACHE_HOME": str(tmp_path / "cache"), "PYTHONWARNINGS": "ignore"}
    done = subprocess.run(
        [sys.executable, str(program), *arguments],
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


@pytest.mark.thorough
@pytest.mark.skipif(not hasattr(os, "fork"), reason="the system has no fork")
def test_fork_during_a_compilation_does_not_change_the_child(tmp_path):
    expected = ["during False False", "child True True", "after True True 2.0"]
    assert states_of_a_compilation(tmp_path) == expected


def test_interrupted_compilation_does_not_change_the_process(tmp_path):
    lines = states_of_a_compilation(tmp_path, "interrupt")
    assert lines == ["during False False", "after True True"]
