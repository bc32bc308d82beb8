"""Compilers, and exported C code called from Python."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

#: Beyond the warnings of the Makefile, which are errors here.
STRICT = "-Werror -Wcast-qual -Wwrite-strings -Wundef"


def compiler(name: str) -> str:
    """Return a compiler, or skip the test."""
    if sys.platform == "win32":
        pytest.skip("the Makefile is for POSIX systems: the exported C code was not compiled")
    if shutil.which(name) is None or shutil.which("make") is None:
        pytest.skip(f"{name} or make is not installed: the exported C code was not compiled by it")
    return name


def make(
    folder: Path, target: str, cc: str = "gcc", level: str = "-O0"
) -> subprocess.CompletedProcess[str]:
    """Run the Makefile; some warnings need a level of optimisation, which takes longer."""
    flags = f"{level} {STRICT}"
    command = ["make", "-C", str(folder), target, f"CC={compiler(cc)}", f"CFLAGS={flags}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


class Library:
    """Exported functions by their names without the prefix.

    A call takes arrays, numbers and None in the order of the header; arrays of results are written.
    """

    def __init__(self, folder: Path, name: str = "arm") -> None:
        path, source = folder / "lib.so", folder / f"{name}.c"
        flags = ["-std=c99", "-O0", "-shared", "-fPIC", "-o", str(path), str(source), "-lm"]
        subprocess.run([compiler("gcc"), *flags], check=True)
        self._name, self._library = name, ctypes.CDLL(str(path))
        header = (folder / f"{name}.h").read_text()
        pairs = re.findall(r"#define (\w+) (\S+)", header)
        self.macros = {key.lower().removeprefix(f"{name}_"): float(value) for key, value in pairs}

    def __call__(self, function: str, *arguments: object) -> None:
        converted = []
        for one in arguments:
            if one is None:
                converted.append(None)
            elif isinstance(one, float):
                converted.append(ctypes.c_double(one))
            else:
                assert isinstance(one, np.ndarray)
                assert one.dtype == np.float64
                assert one.flags.c_contiguous
                converted.append(ctypes.c_void_p(one.ctypes.data))
        getattr(self._library, f"{self._name}_{function}")(*converted)
