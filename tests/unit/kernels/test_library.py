"""The library of kernels: the same bits as compiled on the spot, without Numba, or none at all."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

from flexarm.kernels.compilation import library, private_folder
from flexarm.kernels.compilation.packs import Packs
from kernel_library import built_library

pytestmark = pytest.mark.compiled

#: Results of calls that use the kernels of most wings; each prints a digest of all its bits.
CALLS = """
import hashlib, json, sys, warnings
import numpy as np
if "without numba" in sys.argv:
    sys.modules["numba"] = sys.modules["llvmlite"] = None
import flexarm as fa

warnings.simplefilter("ignore", fa.FlexarmWarning)
arm = fa.load_arm(fa.__path__[0] + "/library/paper.yaml")
q, still = arm.rest([0.3, -0.4]), np.zeros(arm.dof)
torque = lambda t: [0.2 * np.sin(3.0 * t), 0.05]

def of_dataset(dataset):
    return np.concatenate([dataset[name].values.ravel() for name in sorted(dataset.data_vars)
                           if dataset[name].dtype.kind == "f"])

calls = {
    "dynamics": lambda: arm.forward_dynamics(q, still + 0.1, [0.2, 0.1]),
    "explicit": lambda: of_dataset(
        fa.simulate(arm, 0.2, torque=torque, initial=q, integrator="dormand_prince_8")),
    "implicit": lambda: of_dataset(
        fa.simulate(arm, 0.2, torque=torque, initial=q, integrator="kennedy_carpenter_5")),
    "lanes": lambda: of_dataset(
        fa.simulate_batch(arm, 0.1, initial=[q, 0.5 * q, 0.2 * q], progress=False)),
    "duals": lambda: of_dataset(fa.sensitivities(arm, 0.01, ["payload.mass"])),
    "matrices": lambda: np.concatenate(
        [np.ravel(arm.mass_matrix(q)), np.ravel(fa.linearize(arm, bent).A)]),
}
bent = fa.equilibrium(arm, [0.3, -0.4])
names = [name for name in sys.argv[1:] if name in calls]
digests = {name: hashlib.sha256(np.ascontiguousarray(calls[name]()).tobytes()).hexdigest()
           for name in names}
print(json.dumps([digests, "numba" in sys.modules and sys.modules["numba"] is not None]))
"""


def called(choice, *arguments):
    """Return the digests of calls in a new process, and whether it imported Numba."""
    done = subprocess.run(
        [sys.executable, "-c", CALLS, *arguments],
        env={**os.environ, "FLEXARM_KERNELS": choice},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.sampled("dynamics")
@pytest.mark.parametrize("name", ["dynamics", "explicit", "implicit", "lanes", "duals", "matrices"])
def test_library_has_the_bits_of_kernels_compiled_on_the_spot(name):
    built_library()
    built, imported = called("library", name, "without numba")
    assert not imported
    compiled, imported = called("compile", name)
    assert imported
    assert built == compiled
    assert set(built) == {name}


def test_a_run_with_the_library_does_not_import_numba():
    built_library()
    _, imported = called("", "explicit", "matrices")
    assert not imported


@pytest.fixture
def folder(tmp_path):
    """Return a copy of the library of this process."""
    known = built_library()
    for name in (library.TABLE, known.file.name):
        shutil.copy(known.folder / name, tmp_path / name)
    return tmp_path


def changed(folder, **values):
    """Write other values to the table of a library."""
    path = folder / library.TABLE
    table = json.loads(path.read_text(encoding="utf-8"))
    path.write_text(json.dumps({**table, **values}), encoding="utf-8")


@pytest.mark.parametrize("content", ["[]", "{}", "no JSON", '{"files": null}'])
def test_table_that_is_none_leads_to_no_library(folder, monkeypatch, content):
    (folder / library.TABLE).write_text(content, encoding="utf-8")
    monkeypatch.setattr(library, "_folders", lambda: iter([folder]))
    library.loaded.cache_clear()
    try:
        assert library.loaded() is None
        assert str(folder) in library.reason()
    finally:
        monkeypatch.undo()
        library.loaded.cache_clear()


@pytest.mark.parametrize(
    ("name", "value"),
    [("interface", library.INTERFACE + 1), ("sources", "of another version"), ("system", "cp/m")],
)
def test_library_of_another_kind_is_refused(folder, name, value):
    library.Library(folder)
    changed(folder, **{name: value})
    with pytest.raises(OSError, match=f"^{name} {value}"):
        library.Library(folder)


def test_damaged_library_is_refused(folder):
    file = library.Library(folder).file
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.unlink()  # the file that this process has mapped must not change
    file.write_bytes(content)
    with pytest.raises(OSError, match="is damaged"):
        library.Library(folder)


def test_library_that_does_not_load_is_refused(folder):
    file = folder / library.loaded().file.name
    file.unlink()
    file.write_bytes(b"no machine code")
    digest = hashlib.sha256(b"no machine code").hexdigest()
    changed(folder, files=[[1, file.name, digest]])
    with pytest.raises(OSError, match=r"invalid ELF|too short|mach-o"):
        library.Library(folder)


def test_library_for_newer_processors_is_refused(folder):
    known = library.Library(folder)
    digest = hashlib.sha256(known.file.read_bytes()).hexdigest()
    changed(folder, files=[[1000, known.file.name, digest]])
    with pytest.raises(OSError, match="older than those of the library"):
        library.Library(folder)
    changed(folder, files=[[1000, known.file.name, digest], [1, known.file.name, digest]])
    library.Library(folder)


def test_without_a_fitting_library_there_is_none(folder, monkeypatch):
    monkeypatch.setattr(library, "_folders", lambda: iter([folder]))
    library.loaded.cache_clear()
    try:
        assert library.loaded().folder == folder
        changed(folder, sources="of another version")
        library.loaded.cache_clear()
        assert library.loaded() is None
    finally:
        monkeypatch.undo()
        library.loaded.cache_clear()


def test_library_of_a_read_only_installation_needs_no_cache(folder, monkeypatch):
    folder.chmod(0o555)
    monkeypatch.setattr(library, "INSTALLED", folder)
    monkeypatch.setattr(library, "cache_folder", lambda: None)
    library.loaded.cache_clear()
    try:
        assert library.loaded().folder == folder
    finally:
        folder.chmod(0o755)
        monkeypatch.undo()
        library.loaded.cache_clear()


LOADED = """
from flexarm.kernels.compilation import library, private_folder
print(library.loaded().folder.name)
"""


def test_libraries_of_two_versions_lie_side_by_side(folder, tmp_path_factory):
    cache, ours = tmp_path_factory.mktemp("cache"), library.loaded().folder.name
    for name in ("kernels-of-another-version", f"kernels-{private_folder.sources()}"):
        (cache / name).mkdir(mode=0o700)
        for path in folder.iterdir():
            shutil.copy(path, cache / name / path.name)
    changed(cache / "kernels-of-another-version", sources="of-another-version")
    done = subprocess.run(
        [sys.executable, "-c", LOADED],
        env={**os.environ, "FLEXARM_CACHE": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    expected = ours if ours == "machine_code" else f"kernels-{private_folder.sources()}"
    assert done.stdout.strip() == expected


@pytest.mark.skipif(shutil.which("nm") is None, reason="needs nm of the binutils")
def test_library_refers_to_functions_of_mathematics_alone():
    listed = subprocess.run(
        ["nm", "-D", "--undefined-only", built_library().file],
        capture_output=True,
        text=True,
        check=True,
    )
    names = {line.split()[-1].partition("@")[0] for line in listed.stdout.splitlines()}
    mathematics = {"atan2", "ceil", "exp", "floor", "hypot", "log", "pow", "rint", "sincos"}
    assert "exp" in names
    assert names - mathematics - {"memcpy", "memset"} == set()


def text(*arguments):
    """Return the signature of arguments."""
    kinds, words = [], []
    library.flatten(arguments, kinds, words)
    return library.signature(tuple(kinds))


def test_signature_tells_types_axes_and_memory_layout_apart():
    square = np.zeros((2, 3))
    assert text(square, 1.0, 2, True, np.float64(3.0)) == "f8:2C d q ? d"
    assert text(square.T) == "f8:2F"
    assert text(square[:, 1:]) == "f8:2A"
    assert text((square, (1, 2.0))) == "(builtins.tuple:2 f8:2C (builtins.tuple:2 q d"
    assert text(Packs.zeros(2, 3)) == "Packs:3"
    assert text(np.zeros(2, dtype=np.int16), np.zeros(1, dtype=complex)) == "i2:1C c16:1C"
    square.flags.writeable = False
    assert text(square) == "f8:2Cr"
    assert text(np.zeros(2, dtype=">f8")) == ">f8:1C"
    with pytest.raises(KeyError):
        text("a text")


class Forward(NamedTuple):
    x: float
    y: float


class Backward(NamedTuple):
    y: float
    x: float


def test_signature_tells_records_with_the_same_fields_apart():
    assert text(Forward(1.0, 2.0)) != text(Backward(1.0, 2.0)) != text((1.0, 2.0))


MISSING = """
import sys
from flexarm.kernels.compilation.cache import compiled

@compiled
def half(x):
    return 0.5 * x

try:
    half(1.0)
except Exception as error:
    print(type(error).__name__, error)
"""


def test_kernel_without_machine_code_says_why_and_what_to_install():
    built_library()
    done = subprocess.run(
        [sys.executable, "-c", MISSING],
        env={**os.environ, "FLEXARM_KERNELS": "library"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.startswith("InputError the kernel __main__.half has no machine code")
    assert "the library does not contain it" in done.stdout
    assert "FLEXARM_KERNELS=library forbids to compile it" in done.stdout
