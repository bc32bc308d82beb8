"""Full disks, signals, pipes and hostile files: remaining files and printed messages."""

import os
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager

import pytest
from scenarios import GOOD, invoke

import flexarm as fa

COMMAND = [sys.executable, "-c", "from flexarm.cli.main import main; main()"]
FULL = """
import resource
resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))  # the kernel refuses longer files
from flexarm.cli.main import main
main()
"""
posix_only = pytest.mark.skipif(os.name != "posix", reason="needs POSIX")


def run(*arguments, code=None, **options):
    command = [sys.executable, "-c", code] if code else COMMAND
    return subprocess.run(
        [*command, *map(str, arguments)],
        capture_output=True,
        text=True,
        # seconds; ends a test that hangs, because compiling on a busy machine takes minutes
        timeout=1800,
        check=False,
        **options,
    )


OUTPUTS = {
    "run nc": ("run", "--out", "out.nc"),
    "run csv": ("run", "--out", "out.csv"),
    "run plot": ("run", "--plot", "out.png"),
    "run animate": ("run", "--animate", "out.html"),
    "modes csv": ("modes", "--count", "99", "--csv", "out.csv"),
    "linearize mat": ("linearize", "--out", "out.mat"),
    "linearize json": ("linearize", "--out", "out.json"),
    "schema": ("schema", "--out", "out.json"),
}


#: Output of a process at its end is checked, too: for one format that is built in memory, and for
#: one that is not. The others are written in this process, because each start takes seconds.
IN_A_PROCESS = {"run nc", "run csv"}


@contextmanager
def full_disk():
    """Limit the size of files that this process writes to 100 bytes."""
    import resource

    usual, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, most))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (usual, most))


@pytest.mark.sampled("schema")
@posix_only
@pytest.mark.parametrize("what", OUTPUTS)
def test_full_disk_gives_an_error_and_keeps_the_older_file(what, good, tmp_path):
    name, *options, out = OUTPUTS[what]
    path = tmp_path / out
    command = (name, *([] if name == "schema" else [good]), *options, path)
    assert invoke(*command).exit_code == 0
    older = path.read_bytes()
    if what in IN_A_PROCESS:
        ended = run(*command, code=FULL)
        status, printed = ended.returncode, ended.stderr
    else:
        with full_disk():
            outcome = invoke(*command)
        status, printed = outcome.exit_code, outcome.stderr
    assert status == 2
    reported = [line for line in printed.splitlines() if not line.startswith("flexarm: ")]
    reason = "File too large. The older file is unchanged."
    assert reported == [f"{path}: the file could not be written: {reason}"]
    assert path.read_bytes() == older
    assert sorted(tmp_path.iterdir()) == sorted([good, path])


@posix_only
def test_full_disk_keeps_the_older_file_of_a_separation(tmp_path):
    arm = fa.Arm(links=[fa.Link(length=1.0, flexural_rigidity=10.0, mass_per_length=0.5)])
    motion = fa.joint_motion(arm, [0.0], [0.5], 1.0)
    separation = fa.linearize_along(arm, motion, rate=10.0)
    path = tmp_path / "along.npz"
    separation.save(path)
    older = path.read_bytes()
    with full_disk(), pytest.raises(fa.InputError) as caught:
        separation.save(path)
    reason = "File too large. The older file is unchanged."
    assert str(caught.value) == f"{path}: the file could not be written: {reason}"
    assert path.read_bytes() == older
    assert list(tmp_path.iterdir()) == [path]


WAITING = """
import os, signal, sys
from flexarm.cases import results
def parts(*_):
    yield b"half"
    os.kill(os.getpid(), signal.{signal})
    raise RuntimeError("the signal was ignored")
from dataclasses import replace
results.FORMATS[".nc"] = replace(results.FORMATS[".nc"], encode=parts)
from flexarm.cli.main import main
main()
"""


@pytest.mark.thorough
@posix_only
def test_sigterm_while_writing_leaves_no_temporary_file(good, tmp_path):
    ended = run("run", good, "--out", tmp_path / "run.nc", code=WAITING.format(signal="SIGTERM"))
    assert ended.returncode == 143
    assert "Traceback" not in ended.stderr
    assert list(tmp_path.iterdir()) == [good]


PRINTED = """
import os, signal, sys
from flexarm.cli.failures import end_orderly_when_terminated
end_orderly_when_terminated()
sys.stdout = os.fdopen(1, "w")  # buffered, whatever PYTHONUNBUFFERED says
print("printed")
os.kill(os.getpid(), signal.SIGTERM)
print("after the signal")
"""


@posix_only
def test_sigterm_flushes_printed_output():
    ended = run(code=PRINTED)
    assert ended.returncode == 143
    assert ended.stdout == "printed\n"


STALLED = """
import os, signal, sys
from flexarm.cli.failures import end_orderly_when_terminated
end_orderly_when_terminated()
reading, writing = os.pipe()
os.set_blocking(writing, False)
try:
    while True:
        os.write(writing, b"x" * 4096)
except BlockingIOError:
    os.set_blocking(writing, True)
sys.stdout = os.fdopen(writing, "w")
print("printed")
os.kill(os.getpid(), signal.SIGTERM)
"""


@posix_only
def test_sigterm_does_not_wait_for_a_stalled_reader():
    assert run(code=STALLED).returncode == 143


@pytest.mark.thorough
@posix_only
def test_next_write_removes_the_temporary_file_after_sigkill(good, tmp_path):
    out = tmp_path / "run.nc"
    ended = run("run", good, "--out", out, code=WAITING.format(signal="SIGKILL"))
    assert ended.returncode == -signal.SIGKILL
    assert len(list(tmp_path.iterdir())) == 2
    assert invoke("run", good, "--out", out).exit_code == 0
    assert sorted(tmp_path.iterdir()) == sorted([good, out])


@pytest.mark.thorough
def test_import_does_not_change_signal_handlers():
    code = """
import signal
before = signal.getsignal(signal.SIGTERM)
import flexarm as fa
fa.Arm, fa.write_result
from flexarm.cli.main import app
assert signal.getsignal(signal.SIGTERM) is before
"""
    assert run(code=code).returncode == 0


@posix_only
@pytest.mark.parametrize("command", ["check", "modes", "linearize", "run"])
def test_scenario_from_a_pipe_is_read_once(command, good, tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    writer = threading.Thread(target=lambda: pipe.write_text(GOOD))
    writer.start()
    outcome = invoke(command, pipe)
    writer.join()
    assert outcome.exit_code == 0, outcome.output


@posix_only
def test_arm_from_a_pipe_is_read_once(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    arm = "\n".join(line for line in GOOD.splitlines() if line[:3] not in ("mot", "dri", "run"))
    writer = threading.Thread(target=lambda: pipe.write_text(arm))
    writer.start()
    assert invoke("check", pipe).exit_code == 0
    writer.join()


@pytest.mark.thorough
@posix_only
def test_standard_input_is_read(good):
    with open(good) as stream:
        assert run("check", "/dev/stdin", stdin=stream).returncode == 0
    assert run("check", "/dev/stdin", input=GOOD).returncode == 0


@posix_only
def test_pipe_without_a_writer_is_rejected(tmp_path, monkeypatch):
    from flexarm.model.file_format import files

    monkeypatch.setattr(files, "_WAIT_FOR_WRITER", 0.05)
    os.mkfifo(tmp_path / "pipe")
    outcome = invoke("check", tmp_path / "pipe")
    assert outcome.exit_code == 2
    assert "the pipe is empty, and nobody writes into it" in outcome.stderr


@posix_only
def test_pipe_with_a_silent_writer_is_rejected(tmp_path, monkeypatch):
    from flexarm.model.file_format import files

    monkeypatch.setattr(files, "_WAIT_FOR_CONTENT", 0.05)
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    writer = os.open(tmp_path / "pipe", os.O_WRONLY)
    os.close(reader)
    outcome = invoke("check", tmp_path / "pipe")
    os.close(writer)
    assert outcome.exit_code == 2
    assert "nothing was written into the pipe for 0.05 s" in outcome.stderr


HOSTILE = {
    "null": ('"a\\0b"', r"a\x00b"),
    "surrogate": ('"a\\ud800b"', r"a\ud800b"),
    "escape code": ('"a\\e[31mb"', r"a\x1b[31mb"),
    "right to left": ('"a\\u202eb"', r"a\u202eb"),
}


@pytest.mark.parametrize("what", HOSTILE)
def test_control_characters_are_escaped(what, tmp_path):
    written, shown = HOSTILE[what]
    path = tmp_path / "file.yaml"
    run_part = "run: {duration: 0.1}\n"
    path.write_text(f"flexarm: 1\narm: {written}\n{run_part}")  # as a path
    named = invoke("check", path)
    path.write_text(f"{GOOD}{written}: 1\n")  # as a key
    key = invoke("check", path)
    path.write_text(f"{GOOD}events: [{{kind: joint_angle, joint: 1, name: {written}}}]\n")
    name = invoke("check", path)
    for outcome in (named, key, name):
        assert outcome.exit_code == 2
        assert shown in outcome.stderr
        assert all(c == "\n" or c.isprintable() for c in outcome.output)


def test_path_with_escape_codes_is_escaped_in_all_output(good, tmp_path):
    out = tmp_path / "\x1b[31mred.csv"
    outcome = invoke("run", good, "--out", out)
    assert out.exists()
    assert r"\x1b[31mred.csv" in outcome.stdout
    assert "\x1b" not in outcome.output


@pytest.mark.parametrize(
    "content", ["root:x:0:0\nsecret:y\n", "- secret\n", "a: [secret", "{secret: 1}", "secret"]
)
def test_content_of_a_file_that_is_not_an_arm_is_not_printed(content, tmp_path):
    (tmp_path / "other").write_text(content)
    path = tmp_path / "file.yaml"
    path.write_text("flexarm: 1\narm: other\nrun: {duration: 0.1}\n")
    outcome = invoke("check", path)
    assert outcome.exit_code == 2
    assert "secret" not in outcome.output
    assert outcome.stderr == (
        f"{path}:2: arm names 'other', which is not an arm file: it has no key `flexarm`.\n"
    )


LINK = "flexarm: 1\narm: {{gravity: [0.0, -9.81], links: [{{{}}}]}}\n"
#: Links whose dimensions have powers and products that overflow or underflow.
UNREASONABLE = {
    "short": "length: 1.0e-300, flexural_rigidity: 10.0, mass_per_length: 0.3",
    "short, with shear": (
        "length: 1.0e-300, flexural_rigidity: 10.0, mass_per_length: 0.3, "
        "element: timoshenko, shear_rigidity: 1.0"
    ),
    "long": "length: 1.0e+200, flexural_rigidity: 10.0, mass_per_length: 0.3",
    "stiff": "length: 1.0, flexural_rigidity: 1.0e+300, mass_per_length: 1.0e-300",
    "soft": "length: 1.0, flexural_rigidity: 5.0e-324, mass_per_length: 5.0e-324",
    "rigid": "length: 1.0e+300, flexible: false, mass_per_length: 1.0e+300",
}


REFUSED = {
    "a kind that is a list, beside hardware": (
        "check",
        GOOD.replace("rigid_inverse_dynamics", "[1]") + "hardware: {seed: 1}\n",
        "drive.kind must be one of",
    ),
    "an arm without inertia": (
        "linearize",
        LINK.format("length: 1.0e-300, flexible: false, mass_per_length: 1.0"),
        "the mass matrix is singular",
    ),
    **{
        f"{command}: {what}": (command, LINK.format(link), "is beyond the range of")
        for what, link in UNREASONABLE.items()
        for command in ("check", "modes", "linearize")
    },
}


@pytest.mark.parametrize("case", REFUSED)
def test_unusable_files_are_rejected_by_every_command(case, tmp_path):
    command, text, words = REFUSED[case]
    path = tmp_path / "file.yaml"
    path.write_text(text)
    outcome = invoke(command, path)
    assert outcome.exit_code == 2
    assert words in outcome.stderr
