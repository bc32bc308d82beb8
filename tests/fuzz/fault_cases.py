"""Faults of the environment: full disks, killed processes, and damaged or exchanged machine code.

Needs a POSIX system. Each case has its own folder, also for machine code.
"""

from __future__ import annotations

import importlib.util
import os
import resource
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

import flexarm as fa
from flexarm.cases.results import write_figure
from flexarm.cli.failures import end_orderly_when_terminated
from flexarm.kernels.compilation import code_cache, jit
from flexarm.view.plot.histories import signals_figure
from fuzz.base_calls import arm, result
from fuzz.farm import Part
from fuzz.study_calls import samples


@cache
def writers() -> dict[str, Callable[[Path], object]]:
    """Return a writer of each format, by file name."""
    figure, model = signals_figure(result()), fa.linearize(arm())
    separation = fa.linearize_along(
        arm(), fa.joint_motion(arm(), [0.0, 0.0], [0.5, 0.1], 1.0), rate=3.0
    )
    return {
        "file.nc": lambda path: fa.write_result(result(), path),
        "file.csv": lambda path: fa.write_result(result(), path),
        "file.png": lambda path: write_figure(figure, path),
        "file.json": lambda path: fa.save_linear(model, path),
        "file.mat": lambda path: fa.export_mat(arm(), path),
        "file.yaml": lambda path: fa.save_arm(arm(), path),
        "file.npz": lambda path: separation.save(path),
        "file.xml": lambda path: fa.export_mjcf(arm(), path),
        "file.urdf": lambda path: fa.export_urdf(arm(), path),
        "file.py": lambda path: fa.export_exudyn(arm(), path),
        "file.html": lambda path: fa.report(result(), path),
    }


def _chosen(number: int) -> tuple[Path, Callable[[Path], object]]:
    name = sorted(writers())[number % len(writers())]
    return Path(name), writers()[name]


def _left() -> list[str]:
    return [name for name in os.listdir() if name.endswith((".tmp", ".partial"))]


def full_disk(rng: np.random.Generator, number: int) -> None:
    """Write where files cannot grow beyond some length: an error, and the older file intact."""
    path, write = _chosen(number)
    write(path)
    older = path.read_bytes()
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (int(rng.integers(len(older))), before[1]))
    try:
        write(path)
        error = None
    except fa.InputError as raised:
        error = raised
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert error is not None, f"{path}: no error"
    assert path.read_bytes() == older, f"{path} changed"
    assert not _left()


def in_another_process(work: Callable[[], object]) -> int:
    """Call a function in a forked process; return its number."""
    process = os.fork()
    if process:
        return process
    try:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        work()
    except KeyboardInterrupt:
        os._exit(130)
    except SystemExit as leave:
        os._exit(int(leave.code or 0))
    except BaseException:
        os._exit(99)
    os._exit(0)


def _ended(process: int, rng: np.random.Generator, longest: float, by: int) -> None:
    """End a process after a random time."""
    time.sleep(0.01 + longest * rng.random())
    os.kill(process, by)
    os.waitpid(process, 0)


def killed_writer(rng: np.random.Generator, number: int) -> None:
    """End a process that writes one file again and again: the file is complete."""
    path, write = _chosen(number)
    write(path)
    size = path.stat().st_size

    def keep_writing() -> None:
        end_orderly_when_terminated()
        while True:
            write(path)

    by = signal.SIGKILL if number // len(writers()) % 2 == 0 else signal.SIGTERM
    _ended(in_another_process(keep_writing), rng, 0.1, by)
    assert abs(path.stat().st_size - size) < 100  # the whole file, perhaps with another time
    assert by == signal.SIGKILL or not _left()
    write(path)
    assert not _left()


def full_output(rng: np.random.Generator, number: int) -> None:
    """Run a command whose standard output is full: a message and a status, never a traceback."""
    fa.save_arm(arm(), "arm.yaml")
    commands = (["check", "arm.yaml"], ["schema"], ["modes", "arm.yaml"], ["--help"], ["--version"])
    command = [sys.executable, "-m", "flexarm", *commands[number % len(commands)]]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert "Traceback" not in done.stderr, f"{command[3:]}: {done.stderr[-300:]}"
    assert done.returncode, f"{command[3:]}: status 0"


def stopped_study(rng: np.random.Generator, number: int) -> None:
    """Kill a study, or fill its disk, and resume it: the files of an undisturbed one."""
    study = fa.Study(samples())
    study.run("whole.zarr", workers=1, chunk=1, progress=False)
    if number % 2:
        process = in_another_process(lambda: study.run("other.zarr", workers=1, chunk=1))
        _ended(process, rng, 0.3, signal.SIGKILL)
    else:
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(rng.integers(2000)), before[1]))
        try:
            study.run("other.zarr", workers=1, chunk=1, progress=False)
        except fa.InputError:
            pass
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
    resume = Path("other.zarr").exists()
    study.run("other.zarr", workers=1, chunk=1, resume=resume, progress=False)
    contents = [
        {
            str(path.relative_to(store)): path.read_bytes()
            for path in store.rglob("*")
            if path.is_file()
        }
        for store in (Path("whole.zarr"), Path("other.zarr"))
    ]
    assert contents[0] == contents[1]


#: Folder of the kernels that are compiled once.
_PLACE = tempfile.TemporaryDirectory(prefix="flexarm-kernels-")


def kernel(scale: float, place: Path) -> Any:
    """Return a kernel that takes a second or two to compile, in a file of its own."""
    source = place / f"kernel_{scale:g}.py"
    # Every line keeps or shrinks rounding errors, so all correct compilations agree.
    lines = "\n".join(f"    y = np.sin(y + {scale}) + x[{k} % x.size]" for k in range(30))
    head = "import numpy as np\nfrom flexarm.kernels.compilation.cache import compiled\n@compiled\n"
    source.write_text(f"{head}def work(x):\n    y = 0.0\n{lines}\n    return y\n")
    # The name is that of a kernel of the package, whose files are found by their key alone.
    spec = importlib.util.spec_from_file_location(f"flexarm.{source.stem}", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module.work


@cache
def compiled_kernels() -> list[tuple[Any, str, bytes]]:
    """Return two compiled kernels, with the names and contents of their files."""
    place = Path(_PLACE.name)
    kernels = []
    with mock.patch.object(jit, "cache_folder", return_value=place):
        for scale in (1.5, 2.5):
            work = kernel(scale, place)
            work(np.ones(3))
            (path,) = place.glob(f"{work.py_func.__module__}.work-*.code")
            kernels.append((work, path.name, path.read_bytes()))
    return kernels


def _loaded(work: Any) -> Any:
    """Return what the cache in this folder has for a kernel; None if it discards its file."""
    (signature,) = work.dispatcher.signatures
    return code_cache.CodeCache(work.py_func, Path.cwd(), False).load_overload(
        signature, work.dispatcher.targetctx
    )


def damaged_cache(rng: np.random.Generator, number: int) -> None:
    """Load a damaged file of machine code, or that of another kernel: it is discarded."""
    (first, name, content), (_, _, other) = compiled_kernels()
    os.chmod(".", 0o700)
    changed = bytearray(content)
    if number % 4 == 0:
        changed = bytearray(other)
    elif number % 4 == 1:
        for at in rng.integers(len(content), size=rng.choice([1, 10])):
            changed[at] ^= 1 << int(rng.integers(8))
    elif number % 4 == 2:
        at, size = int(rng.integers(len(content))), int(rng.choice([1, 64, 512]))
        changed[at : at + size] = rng.bytes(size)
    else:
        del changed[int(rng.integers(len(content))) :]
    if changed == content:
        return
    Path(name).write_bytes(changed)
    os.chmod(name, 0o600)
    kind = ("exchanged", "flipped", "overwritten", "cut")[number % 4]
    assert _loaded(first) is None, f"a file that is {kind} was loaded"


def interrupted_compilation(rng: np.random.Generator, number: int) -> None:
    """Interrupt a compilation: no incomplete file is left, and the next one is right."""
    with mock.patch.object(jit, "cache_folder", return_value=Path.cwd()):
        work = kernel(3.0 + number, Path.cwd())
        expected = work.py_func(np.ones(3))
        # A shell that starts this in the background lets it ignore the signal.
        before = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            _ended(in_another_process(lambda: work(np.ones(3))), rng, 1.0, signal.SIGINT)
        finally:
            signal.signal(signal.SIGINT, before)
        assert not _left()
        assert np.isclose(work(np.ones(3)), expected, rtol=1e-9)


PARTS = {
    "disk-full": Part(
        "every format written where the disk is full: an `InputError` with the reason; the older "
        "file is intact; no temporary file",
        full_disk,
    ),
    "kills": Part(
        "every format, its process ended by SIGKILL or SIGTERM: the older or the new file, "
        "complete; the next write leaves no temporary file",
        killed_writer,
    ),
    "output-full": Part(
        "commands whose standard output is full: a message and a status, never a traceback",
        full_output,
    ),
    "stores": Part(
        "stores (Zarr) of studies that are killed or whose disk is full, then resumed: the files "
        "of an undisturbed study, to the last bit",
        stopped_study,
    ),
    "cache": Part(
        "damaged files of machine code, and those of other kernels: discarded", damaged_cache
    ),
    "compilation": Part(
        "Ctrl-C while compiling: no incomplete file; the next call compiles and is right",
        interrupted_compilation,
    ),
}
