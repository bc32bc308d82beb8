"""``flexarm warmup``, and the notice in a terminal while kernels compile."""

import io
import re
import time
from types import SimpleNamespace

import pytest
from typer.testing import CliRunner

from flexarm.cli import features
from flexarm.cli.failures import WRONG_INPUT
from flexarm.cli.main import app
from flexarm.kernels.compilation import cache
from flexarm.kernels.compilation.compile_notice import CompileNotice


@pytest.mark.thorough
def test_warmup_prints_the_compiled_features(monkeypatch):
    # Two features only: tests/conformance/test_every_kernel_is_warmed_up.py tests all.
    some = ("forward dynamics and derivatives", "closed loops")
    monkeypatch.setattr(features, "FEATURES", {name: features.FEATURES[name] for name in some})
    before = time.perf_counter()
    outcome = CliRunner().invoke(app, ["warmup"])
    elapsed = time.perf_counter() - before
    assert outcome.exit_code == 0, outcome.output
    words = " ".join(outcome.stdout.split())
    found = re.search(r"2 features are ready after (\d+) s;", words)
    assert found, words
    assert int(found[1]) <= elapsed + 0.5  # rounded


def test_warmup_requires_a_writable_cache(monkeypatch):
    monkeypatch.setattr(cache, "CACHE_DIRECTORY", None)
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
