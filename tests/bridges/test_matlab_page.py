"""The page "Export to MATLAB, MuJoCo, Exudyn and URDF": GNU Octave runs its MATLAB blocks."""

import contextlib
import io
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))

from docs_pages import blocks
from typer.testing import CliRunner

from bridges.octave import octave
from flexarm.cli.main import app

PAGE = "docs/how-to/export-to-other-programs.md"


@pytest.mark.thorough
def test_blocks_of_the_page(tmp_path, monkeypatch):
    """Blocks that need a toolbox have a title and are not run."""
    monkeypatch.chdir(tmp_path)
    statements, expected, language = [], [], ""
    for block in blocks(PAGE):
        if block.language == "bash":
            for line in block.text.splitlines():
                done = CliRunner().invoke(app, line.split()[1:])
                assert done.exit_code == 0, done.output
        elif block.language == "python" and not block.option("requires"):
            with contextlib.redirect_stdout(io.StringIO()):
                exec(block.text, {})
        elif block.language == "matlab" and not block.option("title"):
            statements.append(block.text)
        elif block.language == "text" and language == "matlab":
            expected.append(block.text)
        language = block.language
    diary = ["diary printed.txt", "diary on", *statements, "diary off"]
    octave(tmp_path, "\n".join(diary), {}, ("t",))
    assert len(expected) == 4
    assert (tmp_path / "printed.txt").read_text() == "".join(expected)
