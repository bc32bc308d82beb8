"""Shared library of an FMU, compiled on this machine."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

#: Compilers, in the order of preference.
_COMPILERS = ("cc", "gcc", "clang")
_FLAGS = ("-std=c99", "-O2", "-fPIC", "-shared", "-fvisibility=hidden", "-s")
#: Folder of the library in the archive, by processor and version of FMI.
_FOLDERS = {
    ("x86_64", "2.0"): "linux64",
    ("x86_64", "3.0"): "x86_64-linux",
    ("aarch64", "3.0"): "aarch64-linux",
}


def compiled(fmi: str, name: str, files: dict[str, str], sources: list[str]) -> tuple[str, bytes]:
    """Return the place of the library in the archive and its content.

    Args:
        fmi: version of FMI. name: identifier of the model.
        files: texts by name. sources: names of those to compile.

    Raises:
        OSError: if there is no compiler, it fails, or FMI has no name for this system.
    """
    folder = _FOLDERS.get((platform.machine(), fmi)) if sys.platform == "linux" else None
    if folder is None:
        raise OSError(f"binaries for FMI {fmi} are made on Linux only (x86-64; FMI 3.0 also arm64)")
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise OSError(f"no C compiler was found ({', '.join(_COMPILERS)})")
    with TemporaryDirectory() as temporary:
        place = Path(temporary)
        for file, text in files.items():
            (place / file).write_text(text, encoding="utf-8")
        library = place / f"{name}.so"
        command = [compiler, *_FLAGS, "-o", str(library), *sources, "-lm"]
        done = subprocess.run(
            command, cwd=place, capture_output=True, text=True, errors="replace", check=False
        )
        if done.returncode != 0:
            first = next(iter(done.stderr.splitlines()), "")
            raise OSError(f"the C compiler failed: {first}")
        return f"binaries/{folder}/{name}.so", library.read_bytes()
