"""New figures leave the settings of a backend as they are."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_BACKEND = """
import matplotlib
from matplotlib.backends.backend_agg import *

matplotlib.interactive(True)  # as the backend of notebooks does when it is loaded
"""
_PROGRAM = """
import matplotlib
from flexarm.view.plot.style import panels

with panels(None, 1, (3.0, 2.0), lambda sheet: [sheet.add_subplot()]):
    pass
print(matplotlib.is_interactive())
"""


@pytest.mark.thorough
def test_backend_loaded_by_the_first_figure_stays_interactive(tmp_path: Path) -> None:
    (tmp_path / "backend_of_notebooks.py").write_text(_BACKEND)
    path = os.pathsep.join([str(tmp_path), *sys.path])
    environment = os.environ | {"MPLBACKEND": "module://backend_of_notebooks", "PYTHONPATH": path}
    command = [sys.executable, "-c", _PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.stdout == "True\n", done.stderr
