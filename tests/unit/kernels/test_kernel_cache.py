"""Machine code on disk: kept between processes, never outdated, and private."""

import hashlib
import json
import os
import pickle
import shutil
import stat
import subprocess
import sys
import time
import types
from pathlib import Path

import numpy as np
import pytest

import flexarm
import flexarm as fa

pytestmark = pytest.mark.compiled

NOTICE = "flexarm: compiling for this machine"

# A kernel of the package that calls others, added to the copy; the real ones compile for seconds.
SWING = """
from flexarm.kernels.compilation.cache import compiled, inner
from flexarm.kernels.compilation.numbers import cos, sin

@inner
def up(angle):
    return sin(angle) + 0.0 * cos(angle)

@inner
def down(angle):
    return 3.0 * angle * 0.0

@compiled
def swing(angle):
    return 5.0 * up(angle) + down(angle)
"""
# 5 sin(pi / 6) = 2.5
CALL_SWING = """
import json
import numba
theirs = numba.config.CACHE_DIR
from flexarm.kernels.compilation import cache, private_folder
from flexarm.kernels.swing import swing

print(json.dumps({
    "value": swing(3.141592653589793 / 6),
    "hits": sum(swing.dispatcher.stats.cache_hits.values()),
    "misses": sum(swing.dispatcher.stats.cache_misses.values()),
    "directory": str(private_folder.cache_folder()),
    "seconds": cache.compile_seconds(),
    "config": [theirs, numba.config.CACHE_DIR],
}))
"""


@pytest.fixture
def sandbox(tmp_path):
    """Return a copy of the package's sources, with a separate cache."""
    source = Path(flexarm.__file__).parent
    shutil.copytree(
        source, tmp_path / "src" / "flexarm", ignore=shutil.ignore_patterns("__pycache__")
    )
    kernels = tmp_path / "src" / "flexarm" / "kernels"
    (kernels / "swing.py").write_text(SWING, encoding="utf-8")
    return tmp_path


def run(sandbox, program, **more):
    """Run a program on the copy in a separate process and home; return its output and its
    stderr."""
    environment = {
        **os.environ,
        "PYTHONPATH": str(sandbox / "src"),
        "PYTHONDONTWRITEBYTECODE": "1",
        "XDG_CACHE_HOME": str(sandbox / "cache"),
        "NUMBA_CACHE_DIR": str(sandbox / "theirs"),
        "NUMBA_DISABLE_JIT": "0",
        **more,
    }
    done = subprocess.run(
        [sys.executable, "-c", program],
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.mark.thorough
def test_edited_callee_is_compiled_again_and_the_rest_is_loaded(sandbox):
    callee = sandbox / "src" / "flexarm" / "kernels" / "compilation" / "numbers.py"
    source = callee.read_text(encoding="utf-8")

    fresh, words = run(sandbox, CALL_SWING)
    assert fresh["value"] == pytest.approx(2.5, rel=1e-14)
    assert (fresh["hits"], fresh["misses"]) == (0, 1)
    assert words.count(NOTICE) == 1  # for any number of functions
    assert fresh["seconds"] > 0.0
    assert "compiling took" in words
    assert Path(fresh["directory"]).is_relative_to(sandbox / "cache")
    # Numba's own setting is unchanged, and its folder is empty.
    assert fresh["config"] == [str(sandbox / "theirs")] * 2
    assert not list((sandbox / "theirs").rglob("*flexarm*"))

    again, words = run(sandbox, CALL_SWING)
    assert again["value"] == fresh["value"]
    assert (again["hits"], again["misses"]) == (1, 0)
    assert words == ""
    assert again["seconds"] == 0.0
    assert again["directory"] == fresh["directory"]

    # The kernel's own file is unchanged; an edit of its callee changes the sign of its result.
    assert "return _sine(x)" in source
    edited = source.replace("return _sine(x)", "return -_sine(x)")
    callee.write_text(edited, encoding="utf-8")
    changed, words = run(sandbox, CALL_SWING)
    assert changed["value"] == pytest.approx(-2.5, rel=1e-14)
    assert changed["misses"] == 1
    assert words.count(NOTICE) == 1
    assert changed["directory"] != fresh["directory"]

    callee.write_text(source, encoding="utf-8")
    back, words = run(sandbox, CALL_SWING)
    assert back["value"] == fresh["value"]
    assert (back["hits"], back["misses"]) == (1, 0)
    assert NOTICE not in words


@pytest.fixture
def folder_of(sandbox, monkeypatch):
    """Return the folder for the copy's sources, which are read again in this process."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(sandbox / "cache"))

    def found():
        path = sandbox / "src" / "flexarm" / "kernels" / "compilation" / "private_folder.py"
        module = types.ModuleType("private_folder_of_the_copy")
        module.__file__ = str(path)
        exec(compile(path.read_text(encoding="utf-8"), path, "exec"), module.__dict__)
        return module.cache_folder()

    return found


def test_every_relevant_source_is_part_of_the_key(sandbox, folder_of):
    seen = {folder_of()}
    assert folder_of() in seen
    parts = "kernels/kinematics.py", "integrate/torque.py", "kernels/forces/another.py"
    for name in (*parts, "cli/features.py"):  # the last: what a library contains
        path = sandbox / "src" / "flexarm" / name
        with path.open("a", encoding="utf-8") as file:
            file.write("# more\n")
        assert folder_of() not in seen
        seen.add(folder_of())
    assert all(folder.is_relative_to(sandbox / "cache") for folder in seen)


def test_unused_machine_code_is_removed_and_the_rest_kept(sandbox, folder_of):
    root = sandbox / "cache" / "flexarm"
    long_ago = time.time() - 100 * 24 * 3600
    for name in ("kernels-old", "kernels-young", "kernels-unmarked", "other"):
        (root / name).mkdir(parents=True)
        (root / name / "kernel.code").touch()
    for name in ("kernels-old", "kernels-young", "other"):
        (root / name / ".used").touch()
    for name in ("kernels-old", "other"):
        os.utime(root / name / ".used", (long_ago, long_ago))
    folder_of()
    assert not (root / "kernels-old").exists()
    assert all((root / name).exists() for name in ("kernels-young", "kernels-unmarked", "other"))


# One small kernel outside the package, which compiles in a second.
DOUBLE = """
from flexarm.kernels.compilation.cache import compiled
@compiled
def double(x):
    return FACTOR * x
"""
CALL_DOUBLE = """
import json
from flexarm.kernels.compilation import private_folder
from double import double
print(json.dumps({
    "value": double(1.5),
    "hits": sum(double.dispatcher.stats.cache_hits.values()),
    "directory": str(private_folder.cache_folder()),
}))
"""
posix_only = pytest.mark.skipif(not hasattr(os, "geteuid"), reason="no users on this system")


@pytest.fixture
def doubled(sandbox):
    """Return a function that calls one small kernel in a process with a separate home and temporary
    folder."""
    (sandbox / "temporary").mkdir()

    def call(factor="2.0", **more):
        text = DOUBLE.replace("FACTOR", factor)
        (sandbox / "src" / "double.py").write_text(text, encoding="utf-8")
        answer, words = run(sandbox, CALL_DOUBLE, TMPDIR=str(sandbox / "temporary"), **more)
        assert answer["value"] == float(factor) * 1.5
        return answer, words

    return call


@pytest.mark.thorough
def test_kernel_outside_the_package_is_compiled_again_after_an_edit(doubled):
    assert doubled("2.0")[0]["hits"] == 0
    assert doubled("2.0")[0]["hits"] == 1
    assert doubled("3.0")[0]["hits"] == 0


@pytest.fixture
def blocked(sandbox):
    """Return a path at which no folder can be made by any user, including root."""
    (sandbox / "blocked").touch()
    return {"XDG_CACHE_HOME": str(sandbox / "blocked")}


@pytest.mark.thorough
@posix_only
def test_unwritable_home_is_replaced_by_a_private_folder(doubled, blocked, sandbox):
    first, _ = doubled(**blocked)
    folder = Path(first["directory"])
    assert folder.is_relative_to(sandbox / "temporary")
    assert [stat.S_IMODE(path.stat().st_mode) for path in (folder, folder.parent)] == [0o700] * 2
    assert doubled(**blocked)[0] == {**first, "hits": 1}


@pytest.mark.thorough
@posix_only
@pytest.mark.parametrize("planted", ["open to others", "a link", "of somebody else"])
def test_code_in_a_shared_folder_is_never_loaded(planted, doubled, blocked, sandbox):
    first, _ = doubled(**blocked)
    shared = Path(first["directory"]).parent
    # Every file would raise if it were unpickled.
    code = next(Path(first["directory"]).glob("double.double-*.code"))
    body = pickle.dumps(Bomb())
    code.write_bytes(hashlib.sha256(body).digest() + body)
    if planted == "open to others":
        shared.chmod(0o777)
    elif planted == "a link":
        shared.rename(sandbox / "elsewhere")
        shared.symlink_to(sandbox / "elsewhere")
    elif os.geteuid() == 0:
        os.chown(shared, 65534, 65534)
    else:
        pytest.skip("only root can give a folder to somebody else")
    answer, words = doubled(**blocked)
    assert (answer["directory"], answer["hits"]) == ("None", 0)
    assert "BOMB" not in words


class Bomb:
    """An object that runs code when it is unpickled."""

    def __reduce__(self):
        return exec, ("import sys; print('BOMB', file=sys.stderr)",)


@pytest.mark.thorough
@posix_only
def test_file_of_another_user_is_not_loaded(doubled):
    first, _ = doubled()
    if os.geteuid() != 0:
        pytest.skip("only root can give a file to somebody else")
    code = next(Path(first["directory"]).glob("double.double-*.code"))
    body = pickle.dumps(Bomb())
    code.write_bytes(hashlib.sha256(body).digest() + body)
    os.chown(code, 65534, 65534)
    answer, words = doubled()
    assert answer["hits"] == 0
    assert "BOMB" not in words


# One process for all kinds of damage: a new dispatcher reads the cache as a new process does.
DAMAGED = """
import hashlib, json, pickle, sys
from pathlib import Path
import numpy as np
from flexarm.kernels.compilation import cache, private_folder
import double

[code] = private_folder.cache_folder().glob("double.double-*.code")
whole = code.read_bytes()
middle = len(whole) // 2
other = pickle.dumps(("key", "code"))
damage = {
    "none": whole,
    "empty": b"",
    "truncated": whole[:middle],
    "random": np.random.default_rng(1).bytes(len(whole)),
    # Inside the machine code: without a digest it would be executed.
    "one bit": whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :],
    "of another version": hashlib.sha256(other).digest() + other,
    "none again": None,  # what was compiled last is whole
}
found = {}
for name, content in damage.items():
    if content is not None:
        code.write_bytes(content)
    double_again = cache.compiled(double.double.py_func)
    value = double_again(1.5)
    found[name] = [value, sum(double_again.dispatcher.stats.cache_hits.values())]
print(json.dumps(found))
"""


def test_damaged_file_is_compiled_again(sandbox, doubled):
    doubled()
    found, _ = run(sandbox, DAMAGED)
    assert all(value == 3.0 for value, _ in found.values())
    whole = [name for name, (_, hits) in found.items() if hits]
    assert whole == ["none", "none again"]
    assert len(found) == 7


@pytest.mark.thorough
def test_full_disk_disables_the_cache_only(sandbox):
    full = (
        "import errno, os\n"
        "from flexarm.kernels.compilation import code_cache\n"
        "def full(*_, **__):\n"
        "    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))\n"
        "code_cache.replace_file = full\n"
    )
    answer, words = run(sandbox, full + CALL_SWING)
    assert answer["value"] == pytest.approx(2.5, rel=1e-14)
    assert "the result is not kept: No space left on device." in words


INTERRUPTED = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # shells ignore it in background jobs
from numba.core import event
from flexarm.kernels.compilation import cache

class Interrupt(event.Listener):
    # Ctrl-C in the middle of a compilation, after some kernels are finished.
    finished = 0
    def on_start(self, occurrence):
        if self.finished:
            os.kill(os.getpid(), signal.SIGINT)
    def on_end(self, occurrence):
        self.finished += 1

event.register("numba:compile", Interrupt())
from flexarm.kernels.swing import swing
try:
    swing(0.5)
except KeyboardInterrupt:
    import json
    print(json.dumps("interrupted"))
"""


@pytest.mark.thorough
def test_interrupted_compilation_leaves_a_valid_cache(sandbox):
    assert run(sandbox, INTERRUPTED)[0] == "interrupted"
    assert not list((sandbox / "cache").rglob("*.tmp"))
    assert run(sandbox, CALL_SWING)[0]["value"] == pytest.approx(2.5, rel=1e-14)


WITHOUT_COMPILER = """
import json
import flexarm as fa
link = fa.Link(length=1.0, flexural_rigidity=3.0, mass_per_length=0.5, elements=1)
arm = fa.Arm(links=[link, link], gravity=(0.0, -9.81), theory="second_order")
q = [0.3, 0.001, -0.002, -0.5, 0.003, 0.001]
print(json.dumps(arm.forward_dynamics(q, q, [1.0, -0.5]).tolist()))
"""


@pytest.mark.thorough
def test_kernels_run_as_plain_python(sandbox):
    """For debuggers and coverage: the same sources without a compiler."""
    found, words = run(sandbox, WITHOUT_COMPILER, NUMBA_DISABLE_JIT="1")
    assert NOTICE not in words
    link = fa.Link(length=1.0, flexural_rigidity=3.0, mass_per_length=0.5, elements=1)
    arm = fa.Arm(links=[link, link], gravity=(0.0, -9.81), theory="second_order")
    q = [0.3, 0.001, -0.002, -0.5, 0.003, 0.001]
    # Except for fused multiply-adds.
    np.testing.assert_allclose(found, arm.forward_dynamics(q, q, [1.0, -0.5]), rtol=1e-10)
