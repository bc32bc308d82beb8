"""Machine code on disk: kept between processes, never stale, and nobody else's business."""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import flexarm
import flexarm as fa

NOTICE = "flexarm: compiling for this machine"

# A pendulum of 1 kg and 1 m at 30 degrees in a gravity of 10 m/s^2: 2.5 J above its joint.
PENDULUM = """
import json
import numba
theirs = numba.config.CACHE_DIR
import flexarm as fa
from flexarm.kernels import cache
from flexarm.kernels.observables import energies

link = fa.Link(length=1.0, mass_per_length=1.0, flexible=False)
arm = fa.Arm(links=[link], gravity=(0.0, -10.0))
print(json.dumps({
    "gravity": arm.energy([3.141592653589793 / 6], [0.0]).gravity,
    "hits": sum(energies.stats.cache_hits.values()),
    "misses": sum(energies.stats.cache_misses.values()),
    "directory": str(cache.CACHE_DIRECTORY),
    "seconds": cache.compile_seconds(),
    "config": [theirs, numba.config.CACHE_DIR],
}))
"""


@pytest.fixture
def sandbox(tmp_path):
    """A copy of the package's sources, with caches of its own."""
    source = Path(flexarm.__file__).parent
    shutil.copytree(
        source, tmp_path / "src" / "flexarm", ignore=shutil.ignore_patterns("__pycache__")
    )
    return tmp_path


def run(sandbox, program, **more):
    """Run a program on the copy, in a process and a home of its own: its answer and its stderr."""
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


def test_edited_callee_gives_new_physics_and_everything_else_comes_from_disk(sandbox):
    callee = sandbox / "src" / "flexarm" / "kernels" / "numbers.py"
    source = callee.read_text(encoding="utf-8")

    fresh, words = run(sandbox, PENDULUM)
    assert fresh["gravity"] == pytest.approx(2.5, rel=1e-14)
    assert (fresh["hits"], fresh["misses"]) == (0, 1)
    assert words.count(NOTICE) == 1  # for however many functions
    assert fresh["seconds"] > 0.0
    assert "compiling took" in words
    assert Path(fresh["directory"]).is_relative_to(sandbox / "cache")
    # Numba's own setting is as its user left it, and nothing of ours went there.
    assert fresh["config"] == [str(sandbox / "theirs")] * 2
    assert not list((sandbox / "theirs").rglob("*flexarm*"))

    again, words = run(sandbox, PENDULUM)
    assert again["gravity"] == fresh["gravity"]
    assert (again["hits"], again["misses"]) == (1, 0)
    assert words == ""
    assert again["seconds"] == 0.0
    assert again["directory"] == fresh["directory"]

    # The energies' own file stays: its callee turns gravity around.
    assert "return np.sin(x)" in source
    edited = source.replace("return np.sin(x)", "return -np.sin(x)")
    callee.write_text(edited, encoding="utf-8")
    changed, words = run(sandbox, PENDULUM)
    assert changed["gravity"] == pytest.approx(-2.5, rel=1e-14)
    assert changed["misses"] == 1
    assert words.count(NOTICE) == 1
    assert changed["directory"] != fresh["directory"]

    callee.write_text(source, encoding="utf-8")
    back, words = run(sandbox, PENDULUM)
    assert back["gravity"] == fresh["gravity"]
    assert (back["hits"], back["misses"]) == (1, 0)
    assert NOTICE not in words


WHERE = """
import json
from flexarm.kernels import cache
print(json.dumps(str(cache.CACHE_DIRECTORY)))
"""


def test_every_source_that_decides_takes_part_in_the_key(sandbox):
    first, _ = run(sandbox, WHERE)
    seen = {first}
    for name in ("kernels/kinematics.py", "integrate/torque.py", "kernels/another.py"):
        path = sandbox / "src" / "flexarm" / name
        with path.open("a", encoding="utf-8") as file:
            file.write("# more\n")
        where, _ = run(sandbox, WHERE)
        assert where not in seen
        seen.add(where)


def test_unused_machine_code_is_forgotten_and_the_rest_kept(sandbox):
    root = sandbox / "cache" / "flexarm"
    long_ago = time.time() - 100 * 24 * 3600
    for name in ("kernels-old", "kernels-young", "kernels-unmarked", "other"):
        (root / name).mkdir(parents=True)
        (root / name / "code.nbc").touch()
    for name in ("kernels-old", "kernels-young", "other"):
        (root / name / ".used").touch()
    for name in ("kernels-old", "other"):
        os.utime(root / name / ".used", (long_ago, long_ago))
    run(sandbox, WHERE)
    assert not (root / "kernels-old").exists()
    assert all((root / name).exists() for name in ("kernels-young", "kernels-unmarked", "other"))


def test_a_home_that_cannot_be_written_is_no_obstacle(sandbox):
    blocked = sandbox / "blocked"
    blocked.touch()  # a file where a directory is wanted: fails for every user, root too
    temporary = sandbox / "temporary"
    temporary.mkdir()
    where, _ = run(sandbox, WHERE, XDG_CACHE_HOME=str(blocked), TMPDIR=str(temporary))
    assert Path(where).is_relative_to(temporary)


WITHOUT_COMPILER = """
import json
import flexarm as fa
link = fa.Link(length=1.0, flexural_rigidity=3.0, mass_per_length=0.5, elements=1)
arm = fa.Arm(links=[link, link], gravity=(0.0, -9.81), theory="second_order")
q = [0.3, 0.001, -0.002, -0.5, 0.003, 0.001]
print(json.dumps(arm.forward_dynamics(q, q, [1.0, -0.5]).tolist()))
"""


def test_kernels_run_as_plain_python(sandbox):
    """For debuggers and coverage: the same sources without a compiler."""
    found, words = run(sandbox, WITHOUT_COMPILER, NUMBA_DISABLE_JIT="1")
    assert NOTICE not in words
    link = fa.Link(length=1.0, flexural_rigidity=3.0, mass_per_length=0.5, elements=1)
    arm = fa.Arm(links=[link, link], gravity=(0.0, -9.81), theory="second_order")
    q = [0.3, 0.001, -0.002, -0.5, 0.003, 0.001]
    # Fused multiply-adds apart.
    np.testing.assert_allclose(found, arm.forward_dynamics(q, q, [1.0, -0.5]), rtol=1e-10)
