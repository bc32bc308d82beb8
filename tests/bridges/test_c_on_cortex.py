"""Exported C code on a Cortex-M7 in QEMU, where its programs are installed."""

import shutil
import subprocess
from pathlib import Path

import pytest

import flexarm as fa
from bridges.symbolic_cases import parametric

_BOARD = Path(__file__).parent / "cortex_m7"
_GCC = "arm-none-eabi-gcc"
_QEMU = "qemu-system-arm"
FLAGS = [
    *("-std=c99", "-O2", "-mcpu=cortex-m7", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv5-d16"),
    *("-Wall", "-Wextra", "-Wpedantic", "-Wshadow", "-Werror"),
    # The C library of the processor has no clock; the board's file has one.
    *("-D_POSIX_TIMERS=1", "-D_POSIX_MONOTONIC_CLOCK=1", "-DTIMES", "-DROUNDS=1"),
    *("--specs=rdimon.specs", f"-T{_BOARD / 'link.ld'}"),
]


def run_on_cortex_m7(folder: Path, name: str) -> str:
    """Compile the test program with its measurement of times, run it, and return its output.

    With ``-icount shift=0``, a nanosecond is an instruction.
    """
    sources = [folder / f"{name}_test.c", folder / f"{name}.c", _BOARD / "startup.c"]
    command = [_GCC, *FLAGS, "-o", folder / "test.elf", *sources, "-lm"]
    subprocess.run(list(map(str, command)), check=True)
    machine = ["-M", "mps2-an500", "-nographic", "-icount", "shift=0"]
    machine += ["-semihosting-config", "enable=on,target=native"]
    command = [_QEMU, *machine, "-kernel", folder / "test.elf"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_recorded_run(tmp_path):
    for program in (_GCC, _QEMU):
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed: nothing was tried on a Cortex-M7")
    fa.export_c(parametric("linear"), tmp_path)
    printed = run_on_cortex_m7(tmp_path, "arm")
    assert printed.rstrip().endswith("ok"), printed
