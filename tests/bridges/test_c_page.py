"""The commands of pages about C code, also those of make and of the C compiler."""

import contextlib
import io
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

from docs_pages import blocks
from typer.testing import CliRunner

from bridges.c_code_tools import compiler
from flexarm.cli.main import app

#: Pages, the number of their blocks for a shell, and whether these need the Python blocks before.
PAGES = [("docs/how-to/export-c-code.md", 2, False), ("docs/how-to/run-in-real-time.md", 2, True)]


@pytest.mark.thorough
@pytest.mark.parametrize(("page", "shells", "python"), PAGES)
def test_commands_of_the_page(page, shells, python, tmp_path, monkeypatch):
    compiler("cc")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    scope = {}
    printed = None
    ran = 0
    for block in blocks(page):
        if block.language == "bash":
            for line in block.text.splitlines():
                done = CliRunner().invoke(app, line.split()[1:])
                assert done.exit_code == 0, done.output
            printed = None
        elif block.language == "python" and python:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(block.text, scope)
            printed = None
        elif block.option("title"):
            Path(block.option("title")).write_text(block.text)
        elif block.language == "sh":
            done = subprocess.run(block.text, shell=True, capture_output=True, text=True)
            assert done.returncode == 0, done.stdout + done.stderr
            printed, ran = done.stdout, ran + 1
        elif block.language == "text" and printed is not None:
            pattern = ".*".join(map(re.escape, block.text.strip().split("...")))
            assert re.search(pattern, printed, flags=re.DOTALL), printed
            printed = None
        else:
            printed = None
    assert ran == shells
