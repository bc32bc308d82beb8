"""Damaged files through every command: a message or a result, never a traceback.

A valid file is changed in some of its values, keys or bytes. Runs may take few steps, so most
commands end within a second.
"""

from __future__ import annotations

import copy
import importlib
import os
import random
import shutil
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import yaml
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cases import templates
from flexarm.cli.failures import FAILED_RUN, INTERRUPTED, WRONG_INPUT
from flexarm.cli.main import app
from fuzz.farm import ROOT, Part

SMALL = """\
flexarm: 1
arm:
  gravity: [0.0, -9.81]
  payload: {mass: 0.1, inertia: 0.001}
  joints:
    - {hub_inertia: 0.05}
    - {hub_inertia: 0.05, stiffness: 100.0, damping: 0.1, friction: {coulomb: 0.1}}
  links:
    - {length: 0.6, flexural_rigidity: 500.0, mass_per_length: 0.4, elements: 2, modes: 2}
    - {length: 0.5, material: steel, section: {kind: circle, diameter: 0.01}, elements: 1}
motion: {kind: joint, start: [0.0, 0.0], end: [0.2, 0.1], duration: 0.05}
drive: {kind: joint_pd, proportional: 5.0, derivative: 0.5, sample_time: 0.001}
hardware: {seed: 1}
run: {duration: 0.05, rate: 200}
"""
#: A study of the same arm, and an identification from a record beside the file.
STUDY = """\
motions: {move: {kind: joint, start: [0.0, 0.0], end: [0.2, 0.1], duration: 0.05}}
drives: {pd: {kind: joint_pd, proportional: 5.0, derivative: 0.5, sample_time: 0.001}}
vary: {payload.mass: {kind: normal, mean: 0.1, deviation: 0.01}}
samples: {count: 2, stop: {metric: tip_error_rms}}
rare_failures: {samples: 100, limits: {tip_error_peak: 1.0e-6}}
run: {duration: 0.05, rate: 200}
"""
STUDY = SMALL.partition("motion:")[0] + STUDY
FIT = """\
records: [{path: record.csv, outputs: [joint_angle]}]
free: [payload.mass]
fit: {iterations: 1}
"""
FIT = SMALL.partition("motion:")[0] + FIT
#: A five-bar whose motors move its cranks.
FIVE_BAR = (
    templates.mechanism_files("five-bar")[0]
    + """\
motion:
  {kind: joint, start: [2.2, -1.2, 0.94, 1.2], end: [2, 0, 0.9, 0], duration: 0.1, driven: [1, 3]}
drive: {kind: rigid_inverse_dynamics}
run: {duration: 0.05, rate: 200}
"""
)
#: The mechanisms of ``flexarm init``, in one file each.
MECHANISMS = [
    arm + scenario.partition("arm: arm.yaml\n")[2].replace("duration: 2.0", "duration: 0.05")
    for arm, scenario in map(templates.mechanism_files, templates.MECHANISMS)
]
SCENARIOS = [
    SMALL,
    FIVE_BAR,
    *MECHANISMS,
    *(path.read_text() for path in sorted(ROOT.glob("examples/*.yaml"))),
]
STUDIES = [STUDY, *(path.read_text() for path in sorted(ROOT.glob("examples/studies/*.yaml")))]
DESIGN = ("--computing", "low", "--duration", "0.05")
#: Commands, and the files that they are for.
COMMANDS: tuple[tuple[tuple[str, ...], list[str]], ...] = (
    (("check",), [*SCENARIOS, *STUDIES, FIT]),
    (("modes",), SCENARIOS),
    (("modes", "--sag"), SCENARIOS),
    (("modes", "--to", "0.1,0.2"), SCENARIOS),
    (("modes", "--campbell", "5"), SCENARIOS),
    (("linearize",), SCENARIOS),
    (("run",), SCENARIOS),
    (("run", "--out", "result.nc"), SCENARIOS),
    (("export", "c"), SCENARIOS),
    (("export", "fmu"), SCENARIOS),
    (("export", "mat"), SCENARIOS),
    (("export", "mjcf"), SCENARIOS),
    (("export", "urdf"), SCENARIOS),
    (("export", "exudyn"), SCENARIOS),
    (("design", "--task", "hold", *DESIGN), SCENARIOS),
    (("compare", "--workers", "1"), STUDIES),
    (("sweep", "--workers", "1"), STUDIES),
    (("identify", "--quiet", "--result", "identified.nc"), [FIT]),
)
NUMBERS = [0, -1, 1, 2, 0.5, -0.0, 1e-300, 1e300, 1e-12, 1e12, 1e-160, 1e160, 5e-324, 10**400]
NUMBERS += [float("inf"), float("nan"), 3, 100, 1000000]
TEXTS = ["", "a", "a\0b", "\ud800", "\x1b[31m", "é", "../x", "/etc/passwd", "/", "1e5", "none"]
OTHERS = [None, True, False, [], {}, [1], [[1, 2], [3]], {"kind": [1]}, {"kind": "none"}, {"a": 1}]


def nodes(value: Any, path: tuple[Any, ...] = ()) -> Any:
    """Yield the paths of all values in nested mappings and lists."""
    yield path
    if not isinstance(value, dict | list):
        return
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield from nodes(part, (*path, key))


def with_other_values(text: str, rng: random.Random) -> bytes:
    """Replace, remove, rename or copy some values of a YAML file."""
    content = yaml.safe_load(text)
    for _ in range(rng.choice([1, 1, 1, 2, 4])):
        path = rng.choice(list(nodes(content))[1:] or [()])
        if not path:
            break
        holder = content
        for key in path[:-1]:
            holder = holder[key]
        last = path[-1]
        match rng.choice(
            ["number", "number", "text", "other", "scale", "remove", "rename", "copy"]
        ):
            case "number":
                holder[last] = rng.choice(NUMBERS)
            case "text":
                holder[last] = rng.choice(TEXTS)
            case "other":
                holder[last] = copy.deepcopy(rng.choice(OTHERS))
            case "scale" if isinstance(holder[last], int | float):
                holder[last] = float(holder[last]) * 10.0 ** rng.randint(-30, 30)
            case "remove":
                del holder[last]
            case "rename" if isinstance(holder, dict):
                holder[rng.choice([*TEXTS, "kind", "length"])] = holder.pop(last)
            case _:
                other = content
                for key in rng.choice(list(nodes(content))):
                    other = other[key]
                holder[last] = copy.deepcopy(other)
    return yaml.safe_dump(content).encode("utf-8", "surrogatepass")


def with_other_bytes(whole: bytes, rng: random.Random) -> bytes:
    """Flip, insert, remove or overwrite some bytes of a file, or cut it off."""
    content = bytearray(whole)
    for _ in range(rng.choice([1, 1, 3, 20])):
        at = rng.randrange(len(content) + 1)
        match rng.choice(["flip", "insert", "remove", "overwrite", "cut"]):
            case "flip" if at < len(content):
                content[at] ^= 1 << rng.randrange(8)
            case "insert":
                content[at:at] = rng.choice([b"{", b"[", b"*", b"&", b":", b"\0", b"\x1b", b"\xff"])
            case "remove":
                del content[at : at + rng.choice([1, 8, 100])]
            case "overwrite":
                part = rng.randbytes(rng.choice([1, 8, 512]))
                content[at : at + len(part)] = part
            case _ if rng.random() < 0.2:
                del content[at:]
    return bytes(content)


@cache
def record() -> bytes:
    """Return a record of the arm, for identification."""
    Path("made.yaml").write_text(SMALL)
    fa.write_result(fa.run_scenario("made.yaml"), "made.csv")
    Path("made.yaml").unlink()
    content = Path("made.csv").read_bytes()
    Path("made.csv").unlink()
    return content


@cache
def ready(number: int) -> None:
    """Run a command once: an import that is interrupted cannot be repeated."""
    command, files = COMMANDS[number]
    Path("file.yaml").write_text(files[-1] if command == ("check",) else files[0])
    Path("record.csv").write_bytes(record())
    outcome = invoked(command, "file.yaml")
    assert outcome.exit_code in {0, WRONG_INPUT, FAILED_RUN, INTERRUPTED}, outcome.output
    for path in Path().glob("file*"):
        shutil.rmtree(path) if path.is_dir() else path.unlink()


def invoked(command: tuple[str, ...], path: str) -> Any:
    """Run a command on a file."""
    size = 2 if command[0] == "export" else 1
    return CliRunner().invoke(app, [*command[:size], path, *command[size:]])


def damaged_file(rng: np.random.Generator, number: int) -> None:
    """Damage a file and run a command on it: a message or a result, never a traceback."""
    ready(number % len(COMMANDS))
    chance = random.Random(int(rng.integers(2**62)))
    command, files = COMMANDS[number % len(COMMANDS)]
    text = chance.choice(files)
    structured = chance.random() < 0.5
    change = with_other_values if structured else lambda t, c: with_other_bytes(t.encode(), c)
    content = change(text, chance)
    Path("file.yaml").write_bytes(content)
    Path("record.csv").write_bytes(record())
    stepping = importlib.import_module("flexarm.simulation.run.stepping")
    few = {"_MOST_STEPS": 1e4, "_MOST_STEPS_A_TICK": 1e4}  # the error is that of divergence
    with mock.patch.multiple(stepping, **few):
        outcome = invoked(command, "file.yaml")
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        outcome.exception.add_note(f"{command}: {content!r}"[:2000])
        raise outcome.exception
    assert outcome.exit_code in (0, FAILED_RUN, WRONG_INPUT, INTERRUPTED), outcome.exit_code
    assert "Traceback" not in outcome.output
    assert all(c == "\n" or c.isprintable() for c in outcome.output), repr(outcome.output)
    # An interrupt while a message is printed ends the command without it.
    assert outcome.exit_code in (0, INTERRUPTED) or outcome.stderr.strip()
    assert not [name for name in os.listdir() if name.endswith((".tmp", ".partial"))]


@cache
def result() -> tuple[Any, bytes]:
    """Return a small result and the bytes of its file."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    written = fa.simulate(arm, 0.02, rate=100.0)
    fa.write_result(written, "run.nc")
    return written, Path("run.nc").read_bytes()


def damaged_result(rng: np.random.Generator, number: int) -> None:
    """Damage a result: refused, or read with the same numbers; `report` gives no traceback."""
    written, content = result()
    Path("run.nc").write_bytes(with_other_bytes(content, random.Random(int(rng.integers(2**62)))))
    if number % 20 == 0:
        outcome = CliRunner().invoke(app, ["report", "run.nc"])
        assert outcome.exception is None or isinstance(outcome.exception, SystemExit)
    try:
        read = fa.read_result("run.nc")
    except fa.InputError:
        return
    assert read.identical(written)


PARTS = {
    "files": Part(
        "damaged arms, scenarios, studies and identifications, each through one of all commands: a "
        "result, or a message and exit status 2; never a traceback",
        damaged_file,
    ),
    "results": Part(
        "damaged results (`.nc`): an `InputError`, or the same numbers", damaged_result
    ),
}
