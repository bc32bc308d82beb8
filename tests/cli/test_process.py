"""The installed command as a process: exit statuses, streams, Ctrl-C and imported modules."""

import subprocess
import sys

import pytest
from scenarios import GOOD, WRONG

# Equals the installed script, wherever it is installed.
COMMAND = [sys.executable, "-c", "from flexarm.cli.main import main; main()"]


# Seconds; ends a test that hangs. Compiling on a busy machine takes minutes.
HANGS = 1800


def run(*arguments, code=None):
    command = [sys.executable, "-c", code] if code else COMMAND
    return subprocess.run(
        [*command, *map(str, arguments)], capture_output=True, text=True, timeout=HANGS, check=False
    )


@pytest.mark.thorough
def test_exit_status_of_a_valid_and_an_invalid_file(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text(GOOD)
    good = run("check", path)
    assert (good.returncode, good.stderr) == (0, "")
    path.write_text(WRONG["negative"][0])
    bad = run("check", path)
    assert (bad.returncode, bad.stdout) == (2, "")
    assert bad.stderr.startswith(f"{path}:4: arm.links[0].length must be greater than 0")
    assert bad.stderr.count("\n") == 1


def test_help_imports_nothing_heavy():
    heavy = ["numpy", "scipy", "numba", "pydantic", "xarray", "matplotlib", "yaml"]
    code = f"""
import sys
from flexarm.cli.main import main
try:
    main()
finally:
    print([name for name in {heavy} if name in sys.modules], file=sys.stderr)
"""
    shown = run("--help", code=code)
    assert shown.returncode == 0
    assert "Usage" in shown.stdout
    assert shown.stderr == "[]\n"


@pytest.mark.thorough
def test_ctrl_c_interrupts_a_run(tmp_path):
    # The run simulates an hour, and the signal is sent at the first report of progress. A shell
    # starts background jobs with Ctrl-C ignored, and Python keeps that setting.
    path = tmp_path / "long.yaml"
    path.write_text(GOOD.replace("duration: 0.05, rate: 200}", "duration: 3600, rate: 10}"))
    code = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
from flexarm.simulation.run.progress import Meter
Meter.update = lambda self, fraction: os.kill(os.getpid(), signal.SIGINT)
from flexarm.cli.main import main
main()
"""
    stopped = run("run", path, "--out", tmp_path / "run.nc", code=code)
    assert stopped.returncode == 130
    assert stopped.stderr.splitlines()[-1] == "stopped by Ctrl-C"
    assert "Traceback" not in stopped.stderr
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.thorough
def test_closed_output_pipe_ends_the_command_silently(tmp_path):
    code = f"""
import subprocess, sys
writer = subprocess.Popen({COMMAND!r} + ["schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
writer.stdout.readline()
writer.stdout.close()
sys.stderr.buffer.write(writer.stderr.read())
"""
    assert "Traceback" not in run(code=code).stderr


def test_drawing_processes_load_no_kernels():
    code = """
import sys
from flexarm.cli.commands.paper import load_plotting
load_plotting()
print([name for name in ("numba", "scipy", "xarray") if name in sys.modules])
"""
    shown = run(code=code)
    assert (shown.returncode, shown.stdout) == (0, "[]\n"), shown.stderr
