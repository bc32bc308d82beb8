"""Build hook: put the library of kernels into wheels, compiled for the platform of the build."""

from __future__ import annotations

import importlib.util
import os
import platform
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

#: Where the library lies in a wheel; `flexarm.kernels.compilation.library` looks for it there.
_PLACE = "flexarm/kernels/machine_code"
_CORE = ("numba", "numpy", "scipy", "pydantic", "xarray", "typer")


class KernelLibrary(BuildHookInterface):
    """Compile the kernels, which takes some minutes; without a compiler the wheel has none.

    Such a wheel needs what the extra ``jit`` installs, and kernels compile when they are first
    used. The environment variable ``FLEXARM_BUILD=pure`` asks for it. ``FLEXARM_BUILD=release``
    compiles for all processors of the family, names the wheel so, and raises an error if that
    fails.
    """

    _folder: tempfile.TemporaryDirectory[str] | None = None

    def dependencies(self) -> list[str]:
        """Return what the compilation needs: the package runs small examples of each feature."""
        if os.environ.get("FLEXARM_BUILD") == "pure":
            return []
        metadata = self.metadata.core
        return [*metadata.dependencies, *metadata.optional_dependencies["jit"]]

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile before a wheel is written; an editable installation compiles when it is used."""
        wish = os.environ.get("FLEXARM_BUILD", "")
        build_data["dependencies"] += self.metadata.core.optional_dependencies["jit"]
        if version == "editable" or wish == "pure":
            return
        failure = self._compile(every=wish == "release")
        if failure and wish == "release":
            raise RuntimeError(failure)
        if failure:
            self.app.display_warning(
                f"flexarm: {failure}; kernels compile when they are first used"
            )
            return
        build_data["dependencies"].clear()
        build_data["force_include"].update(
            {str(path): f"{_PLACE}/{path.name}" for path in Path(self._folder.name).iterdir()}
        )
        build_data["pure_python"] = False
        # ctypes loads the library, so that one wheel serves all versions of Python.
        build_data["tag"] = f"py3-none-{_platform(wish)}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder when the wheel is written."""
        if self._folder is not None:
            self._folder.cleanup()

    def _compile(self, every: bool) -> str:
        """Compile into a temporary folder; return why that failed, or nothing."""
        missing = [name for name in _CORE if importlib.util.find_spec(name) is None]
        if missing:
            return f"{', '.join(missing)} not installed for the build"
        self._folder = tempfile.TemporaryDirectory(prefix="flexarm-kernels-")
        command = [sys.executable, "-m", "flexarm", "warmup"]
        # An isolated build finds its packages by this variable, too.
        folders = [os.path.join(self.root, "src"), os.environ.get("PYTHONPATH")]
        done = subprocess.run(
            [*command, "--into", self._folder.name, *(["--every-processor"] if every else [])],
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(filter(None, folders)),
                "NUMBA_DISABLE_JIT": "0",
            },
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
        return done.stderr.strip() if done.returncode else ""


def _platform(wish: str) -> str:
    """Return the platforms of a wheel; a release needs no symbol of a certain C library."""
    machine = platform.machine().lower()
    if wish == "release" and sys.platform == "linux":
        return f"manylinux_2_17_{machine}.musllinux_1_1_{machine}"
    if sys.platform == "darwin":  # the platform of Python may be that of two processor families
        return f"macosx_11_0_{machine}"
    return sysconfig.get_platform().replace("-", "_").replace(".", "_")
