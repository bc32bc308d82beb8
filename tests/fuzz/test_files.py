"""Damaged files through every command: a message or a result, never a traceback.

A valid file is changed in some of its values, keys or bytes. Runs may take few steps, so most
commands end within a second. One that does not is interrupted, as by Ctrl-C, which is an allowed
outcome, so that the fuzzer does not depend on the speed of the machine.
"""

import copy
import importlib
import os
import random
import signal
import tempfile
import warnings
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

import flexarm as fa
from flexarm.cli.failures import FAILED_RUN, INTERRUPTED, WRONG_INPUT
from flexarm.cli.main import app

FUZZ = settings.get_profile("fuzz")
ROOT = Path(__file__).parents[2]
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
FILES = [
    SMALL,
    *(path.read_text() for path in sorted(ROOT.glob("examples/*.yaml"))),
    *(path.read_text() for path in sorted(ROOT.glob("examples/studies/*.yaml"))),
]
COMMANDS = (
    ("check",),
    ("modes",),
    ("modes", "--sag"),
    ("modes", "--to", "0.1,0.2"),
    ("modes", "--campbell", "5"),
    ("linearize",),
    ("run",),
    ("compare",),
)
NUMBERS = [0, -1, 1, 2, 0.5, -0.0, 1e-300, 1e300, 1e-12, 1e12, 1e-160, 1e160, 5e-324, 10**400]
NUMBERS += [float("inf"), float("nan"), 3, 100, 1000000]
TEXTS = ["", "a", "a\0b", "\ud800", "\x1b[31m", "é", "../x", "/etc/passwd", "/", "1e5", "none"]
OTHERS = [None, True, False, [], {}, [1], [[1, 2], [3]], {"kind": [1]}, {"kind": "none"}, {"a": 1}]


def nodes(value, path=()):
    """Yield the paths of all values in nested mappings and lists."""
    yield path
    if not isinstance(value, dict | list):
        return
    for key, part in value.items() if isinstance(value, dict) else enumerate(value):
        yield from nodes(part, (*path, key))


def with_other_values(text, rng):
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


def with_other_bytes(content, rng):
    """Flip, insert, remove or overwrite some bytes of a file, or cut it off."""
    content = bytearray(content)
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


#: Seconds after which a command is interrupted.
PATIENCE = 30.0


@contextmanager
def interrupted_after(seconds):
    """Raise KeyboardInterrupt once in the block after some time."""

    def interrupt(*_):
        raise KeyboardInterrupt

    theirs = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, theirs)


def assert_message_or_result(command, path):
    """Run a command on a file and check how it ends."""
    try:
        with interrupted_after(PATIENCE), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of numbers near the largest float
            outcome = CliRunner().invoke(app, [command[0], str(path), *command[1:]])
    except KeyboardInterrupt:
        return  # between the command and the test
    if outcome.exception is not None and not isinstance(outcome.exception, SystemExit):
        raise outcome.exception
    assert outcome.exit_code in (0, FAILED_RUN, WRONG_INPUT, INTERRUPTED)
    assert "Traceback" not in outcome.output
    assert all(c == "\n" or c.isprintable() for c in outcome.output), repr(outcome.output)
    # An interrupt while a message is printed ends the command without it.
    if outcome.exit_code not in (0, INTERRUPTED):
        assert outcome.stderr.strip()


needs_timer = pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers here")


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Run every command once without interrupts, because an interrupted import cannot be repeated.

    After that, runs may take fewer steps than usual.
    """
    path = tmp_path_factory.mktemp("good") / "file.yaml"
    path.write_text(SMALL)
    for command in COMMANDS:
        outcome = CliRunner().invoke(app, [command[0], str(path), *command[1:]])
        assert outcome.exit_code == (2 if {"compare", "--campbell"} & {*command} else 0)
    with pytest.MonkeyPatch.context() as patch:
        # The error of too many steps is that of a diverging motion.
        stepping = importlib.import_module("flexarm.engine.stepping")
        patch.setattr(stepping, "_MOST_STEPS", 1e4)
        patch.setattr(stepping, "_MOST_STEPS_A_TICK", 1e4)
        yield


@needs_timer
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@given(rng=st.randoms(use_true_random=False), text=st.sampled_from(FILES), structured=st.booleans())
@FUZZ
def test_damaged_descriptions_give_a_message(imported, rng, text, structured):
    content = with_other_values(text, rng) if structured else with_other_bytes(text.encode(), rng)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "file.yaml")
        path.write_bytes(content)
        # One command of those that compute, because all read the file in the same way.
        for command in (COMMANDS[0], rng.choice(COMMANDS[1:])):
            assert_message_or_result(command, path)
        assert os.listdir(folder) == ["file.yaml"]


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    """Return a small result and the bytes of its file."""
    arm = fa.Arm(links=[fa.Link(length=1.0, mass_per_length=1.0, flexible=False)])
    path = tmp_path_factory.mktemp("result") / "run.nc"
    written = fa.simulate(arm, 0.02, rate=100.0)
    fa.write_result(written, path)
    return written, path.read_bytes()


@given(seed=st.integers(0, 2**32))
@FUZZ
def test_damaged_results_give_a_message(result, seed):
    written, content = result
    damaged = with_other_bytes(content, random.Random(seed))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "run.nc")
        path.write_bytes(damaged)
        try:
            found = fa.read_result(path)
        except fa.InputError:
            return
        assert found.identical(written)
