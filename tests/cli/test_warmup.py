"""``flexarm warmup``, and the notice in a terminal while kernels compile."""

import io
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from flexarm.cli.failures import WRONG_INPUT
from flexarm.cli.main import app
from flexarm.kernels.compilation import library, private_folder
from flexarm.kernels.compilation.compile_notice import CompileNotice
from kernel_library import built_library


@pytest.mark.thorough
def test_warmup_builds_a_library(tmp_path):
    # Some features only, in a process whose cache is empty: the whole takes minutes.
    program = (
        "import sys\n"
        "from flexarm.cli import features\n"
        "some = ('mechanisms', 'linear control')\n"
        "features.FEATURES = {name: features.FEATURES[name] for name in some}\n"
        "from flexarm.cli.main import main\n"
        "sys.argv = ['flexarm', 'warmup', '--into', sys.argv[1]]\n"
        "if __name__ == '__main__':\n    main()\n"
    )
    (tmp_path / "program.py").write_text(program, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(tmp_path / "program.py"), str(tmp_path / "library")],
        env={**os.environ, "FLEXARM_KERNELS": "compile"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert library.Library(tmp_path / "library").file.stat().st_size > 1e5
    words = " ".join(done.stdout.split())
    assert re.search(r"Ready after \d+ s; compiling took \d+ s of one core\.", words)


def test_warmup_names_the_library_that_is_there():
    known = built_library()
    outcome = CliRunner().invoke(app, ["warmup"])
    assert outcome.exit_code == 0, outcome.output
    words = outcome.stdout.replace("\n", "")
    assert words == f"The library of kernels is in {known.folder}."


def test_warmup_copies_the_library_that_is_there(tmp_path):
    built_library()
    outcome = CliRunner().invoke(app, ["warmup", "--into", str(tmp_path / "new")])
    assert outcome.exit_code == 0, outcome.output
    assert library.Library(tmp_path / "new").file.parent == tmp_path / "new"


def test_warmup_requires_a_writable_cache(monkeypatch):
    monkeypatch.setattr(library, "loaded", lambda: None)
    monkeypatch.setattr(private_folder, "cache_folder", lambda: None)
    outcome = CliRunner().invoke(app, ["warmup"])
    assert outcome.exit_code == WRONG_INPUT
    assert "the cache folder cannot be created" in outcome.stderr


class Terminal(io.StringIO):
    def isatty(self):
        return True


def compiling(notice, name):
    """Simulate the compilation of a kernel under a notice."""
    function = SimpleNamespace(__module__="flexarm.kernels.any", __name__=name)
    seen = SimpleNamespace(data={"dispatcher": SimpleNamespace(py_func=function)})
    notice.on_start(seen)
    notice.on_end(seen)


def test_terminal_shows_the_kernel_that_compiles(monkeypatch):
    monkeypatch.setattr(
        "flexarm.kernels.compilation.compile_notice.atexit", SimpleNamespace(register=id)
    )
    for stream, shown in ((Terminal(), True), (io.StringIO(), False)):
        monkeypatch.setattr("sys.stderr", stream)
        notice = CompileNotice(kept=True)
        compiling(notice, "poses")
        compiling(notice, "energies")
        assert notice.kernels == 2
        assert stream.getvalue().count("compiling for this machine, once") == 1
        assert ("energies (1 compiled" in stream.getvalue()) == shown


def test_silent_notice_prints_nothing(monkeypatch):
    stream = Terminal()
    monkeypatch.setattr("sys.stderr", stream)
    notice = CompileNotice(kept=True)
    notice.silent = True
    compiling(notice, "poses")
    assert stream.getvalue() == ""
    assert notice.kernels == 1
