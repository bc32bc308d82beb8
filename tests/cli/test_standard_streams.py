"""Standard streams that cannot be written: full disks and closed pipes, for every command."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import typer.main

from flexarm.cli.main import app

posix_only = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
FULL = os.strerror(errno.ENOSPC)

#: Runs commands in copies of one process, each with one full or closed stream.
MANY = """
import json, os, sys
import rich.console, typer.rich_utils  # here once, and not in every copy
import flexarm.cases.scenario.study, flexarm.linear
from flexarm.cli.main import main
outcomes = []
for arguments, kind in json.load(sys.stdin):
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.dup2(writing, 2)
        closed = os.pipe()
        os.close(closed[0])
        full = os.open("/dev/full", os.O_WRONLY)
        os.dup2(closed[1] if kind == "pipe" else full, 2 if kind == "error" else 1)
        sys.argv = ["flexarm", *arguments]
        try:
            main()
            sys.stdout.flush()
            sys.exit(0)
        except SystemExit as leave:
            os._exit(leave.code or 0)
        except BaseException:
            import traceback
            traceback.print_exc()
            sys.stderr.flush()
            os._exit(99)
    os.close(writing)
    with open(reading) as stream:
        text = stream.read()
    outcomes.append([os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), text])
print(json.dumps(outcomes))
"""


def outcomes(*cases):
    """Return exit status and error stream of commands, each with a kind of fault."""
    done = subprocess.run(
        [sys.executable, "-c", MANY],
        input=json.dumps(cases),
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "FORCE_COLOR": "1"},  # as on a terminal, with live progress bars
    )
    return json.loads(done.stdout.splitlines()[-1])


def commands():
    """Return the words of every command and group of the command line."""
    names, waiting = [], [((), typer.main.get_command(app))]
    while waiting:
        words, command = waiting.pop()
        names.append(words)
        waiting += [((*words, n), c) for n, c in getattr(command, "commands", {}).items()]
    return names


def line(reason):
    return f"flexarm: standard output could not be written: {reason}.\n"


@pytest.mark.thorough
@posix_only
def test_every_command_reports_a_standard_output_that_cannot_be_written(good, tmp_path):
    """The help of every command, and the output of some that print in different ways."""
    cases = [[*words, "--help"] for words in commands()]
    assert len(cases) > 15
    cases += [["--version"], ["schema"], ["check", str(good)], ["modes", str(good)], []]
    found = outcomes(*((case, kind) for kind in ("full", "pipe") for case in cases))
    reasons = [FULL] * len(cases) + [os.strerror(errno.EPIPE)] * len(cases)
    for case, (status, printed), reason in zip(2 * cases, found, reasons, strict=True):
        assert (status, printed) == (2, line(reason)), case


@pytest.mark.thorough
@posix_only
def test_files_are_written_although_the_output_is_not(tmp_path):
    ((status, printed),) = outcomes((["init", str(tmp_path / "arm")], "full"))
    assert (status, printed) == (2, line(FULL))
    assert len(list((tmp_path / "arm").iterdir())) == 2


@pytest.mark.thorough
@posix_only
def test_an_error_stream_that_cannot_be_written_changes_nothing(good, tmp_path):
    """Neither the exit status of an error, nor a run with its progress."""
    wrong, out = tmp_path / "none.yaml", tmp_path / "out.csv"
    found = outcomes(
        (["check", str(wrong)], "error"), (["run", str(good), "--out", str(out)], "error")
    )
    assert found == [[2, ""], [0, ""]]
    assert out.exists()


@posix_only
def test_a_progress_bar_on_a_full_disk_prints_no_traceback():
    """Its thread writes, too."""
    code = """
import threading
from flexarm.cli.failures import checked_streams
with checked_streams():
    other = threading.Thread(target=lambda: print("x" * 10**6))
    other.start()
    other.join()
"""
    with open("/dev/full", "w") as full:
        done = subprocess.run(
            [sys.executable, "-c", code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert (done.returncode, done.stderr) == (2, line(FULL))


def test_characters_that_the_encoding_lacks_are_escaped():
    code = """
from flexarm.cli.failures import checked_streams
with checked_streams():
    print("90\\u00b0 \\u221e")
"""
    environment = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment)
    assert done.returncode == 0
    assert done.stdout.split() == [rb"90\xb0", rb"\u221e"]
