"""The wheel is built, inspected, and installed into an empty environment.

Nothing is downloaded. The wheel is built without isolation, by the build backend of the extra
`dev`, and the new environment finds the dependencies in the one that runs the tests.
"""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
import sysconfig
import zipfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace

import pytest

import flexarm as fa
from arms import table_one_arm
from flexarm.base import references
from flexarm.kernels.compilation.library import TABLE
from kernel_library import built_library

ROOT = Path(__file__).resolve().parents[2]
#: The installed package must not use files of the source folder.
CLEAN = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "PYTHONHOME")}


def run(*command: str | Path, cwd: Path, environ: dict[str, str] = CLEAN) -> str:
    """Run a command and return its output; a failure shows both streams."""
    done = subprocess.run(
        [*map(str, command)], cwd=cwd, env=environ, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, f"{command}\n{done.stdout}\n{done.stderr}"
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("hatchling", reason="the build backend comes with: pip install -e '.[dev]'")
    pytest.importorskip("pip", reason="this environment has no pip to build a wheel with")
    built_library()  # the hook copies it
    return build(tmp_path_factory.mktemp("wheel"), CLEAN)


def build(folder: Path, environ: dict[str, str]) -> Path:
    """Build a wheel in a folder."""
    offline = ("--no-index", "--no-deps", "--disable-pip-version-check")
    pip = (sys.executable, "-m", "pip")
    made = (*pip, "wheel", "--no-build-isolation", *offline, "-w", folder, ROOT)
    run(*made, cwd=folder, environ=environ)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return programs of a new environment that contains only the wheel."""
    folder = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", folder, cwd=folder)
    programs = folder / ("Scripts" if os.name == "nt" else "bin")
    python = programs / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "install")
    offline = ("--no-index", "--no-deps", "--no-compile", "--disable-pip-version-check")
    run(*pip, *offline, wheel, cwd=folder)
    # These folders come after its own. Python does not follow the .pth files in them, and so it
    # does not find an editable installation of flexarm there.
    found = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder)
    folders = [entry for entry in sys.path if entry.endswith("-packages")]
    Path(found.strip(), "dependencies.pth").write_text("\n".join(folders) + "\n")
    return programs


def test_wheel_contains_the_package_only(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    information = {name for name in names if re.match(r"flexarm-[^/]*\.dist-info/", name)}
    source = ROOT / "src"
    files = [path for path in (source / "flexarm").rglob("*") if path.is_file()]
    expected = {str(p.relative_to(source).as_posix()) for p in files if p.suffix != ".pyc"}
    brought = {name for name in names if "/machine_code/" in name}
    assert names - information - brought == {n for n in expected if "/machine_code/" not in n}
    assert {
        "flexarm/py.typed",
        "flexarm/library/paper.yaml",
        "flexarm/library/cards/whip.yaml",
        "flexarm/library/mechanisms/crane/arm.yaml",
    } <= names
    assert not [name for name in names if "test" in name.partition("/")[0]]
    assert {"METADATA", "WHEEL", "entry_points.txt", "LICENSE"} <= {
        name.rpartition("/")[2] for name in information
    }


def test_isolated_build_keeps_the_packages_that_pip_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("hatchling")
    spec = importlib.util.spec_from_file_location("hatch_build", ROOT / "hatch_build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    hook = object.__new__(module.KernelLibrary)
    monkeypatch.setattr(module.KernelLibrary, "root", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", "overlay")
    seen: list[str] = []

    def started(command: list[str], env: dict[str, str], **more: object) -> SimpleNamespace:
        seen.append(env["PYTHONPATH"])
        return SimpleNamespace(returncode=0, stderr="")

    monkeypatch.setattr(module.subprocess, "run", started)
    assert hook._compile(every=False) == ""
    hook.finalize("standard", {}, "")
    assert seen == [os.pathsep.join([str(tmp_path / "src"), "overlay"])]


def test_wheel_is_for_every_python_of_one_platform(wheel: Path) -> None:
    start, platform = wheel.name.removesuffix(".whl").rsplit("-", 1)
    assert start == f"flexarm-{version('flexarm')}-py3-none"
    assert platform == sysconfig.get_platform().replace("-", "_").replace(".", "_")


def test_wheel_brings_the_library_of_kernels(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as archive:
        sizes = {info.filename: info.file_size for info in archive.infolist()}
    brought = {Path(name).name: size for name, size in sizes.items() if "/machine_code/" in name}
    assert TABLE in brought
    assert len(brought) == 2
    assert max(brought.values()) < 8e6  # bytes


def test_wheel_without_the_library_needs_numba(wheel: Path, tmp_path: Path) -> None:
    def needs(file: Path) -> list[str]:
        with zipfile.ZipFile(file) as archive:
            (name,) = (n for n in archive.namelist() if n.endswith(".dist-info/METADATA"))
            lines = archive.read(name).decode().splitlines()
        return [line for line in lines if line.startswith("Requires-Dist: numba")]

    pure = build(tmp_path, {**CLEAN, "FLEXARM_BUILD": "pure"})
    assert pure.name.endswith("py3-none-any.whl")
    assert [line for line in needs(pure) if "extra ==" not in line]
    assert not [line for line in needs(wheel) if "extra ==" not in line]


def test_sources_that_are_not_installed_simulate(monkeypatch: pytest.MonkeyPatch) -> None:
    # A build runs the examples of `flexarm warmup` from the sources, before there is metadata.
    def missing(name: str) -> str:
        raise PackageNotFoundError(name)

    monkeypatch.setattr(references, "version", missing)
    references.package_version.cache_clear()
    try:
        result = fa.simulate(table_one_arm(), 0.01)
    finally:
        references.package_version.cache_clear()
    assert result.attrs["flexarm_version"] == "unknown"


@pytest.mark.thorough
def test_installed_package_simulates_without_numba_and_writes_no_cache(
    environment: Path, tmp_path: Path
) -> None:
    code = (
        "import sys\nsys.modules['numba'] = sys.modules['llvmlite'] = None\n"
        "import flexarm as fa\n"
        "arm = fa.load_arm(fa.__path__[0] + '/library/paper.yaml')\n"
        "result = fa.simulate(arm, 0.1, torque=lambda t: [0.1, 0.0])\n"
        "print(float(result.tip[-1, 0]))"
    )
    environ = {**CLEAN, "XDG_CACHE_HOME": str(tmp_path / "cache"), "FLEXARM_KERNELS": ""}
    done = subprocess.run(
        [environment / "python", "-c", code],
        cwd=tmp_path,
        env=environ,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) > 1.0
    assert not (tmp_path / "cache").exists()


@pytest.mark.thorough
def test_installed_command_starts(environment: Path, tmp_path: Path) -> None:
    printed = run(environment / "flexarm", "--version", cwd=tmp_path)
    assert printed == f"flexarm {version('flexarm')}\n"


@pytest.mark.thorough
def test_installed_package_reads_its_library(environment: Path, tmp_path: Path) -> None:
    code = "import flexarm; print(flexarm.__file__)"
    package = Path(run(environment / "python", "-c", code, cwd=tmp_path).strip()).parent
    assert package.is_relative_to(environment.parent)
    checked = run(environment / "flexarm", "check", package / "library/paper.yaml", cwd=tmp_path)
    assert checked.splitlines()[-1] == "ok"
