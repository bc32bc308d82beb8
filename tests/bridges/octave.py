"""GNU Octave, which runs exported MATLAB files."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from scipy.io import loadmat, savemat


def octave(
    folder: Path, script: str, given: Mapping[str, Any], results: tuple[str, ...]
) -> dict[str, Any]:
    """Run a script in a folder with given variables, and return its results; skip without Octave.

    Only the language itself is used: no package of Octave is loaded.
    """
    program = shutil.which("octave-cli") or shutil.which("octave")
    if program is None:
        pytest.skip("GNU Octave is not installed: the MATLAB files were not run")
    savemat(folder / "given.mat", dict(given), oned_as="column")
    names = ", ".join(f"'{name}'" for name in results)
    text = f"load('given.mat');\n{script}\nsave('-v6', 'results.mat', {names});\n"
    (folder / "script_of_test.m").write_text(text)
    command = [program, "--norc", "--no-gui", "--quiet", "script_of_test.m"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    found = loadmat(folder / "results.mat", simplify_cells=True)
    return {name: found[name] for name in results}
