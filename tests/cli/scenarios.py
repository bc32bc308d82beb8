"""A call of the command line, a valid scenario file, and invalid variants of it."""

from __future__ import annotations

from typing import Any

from typer.testing import CliRunner

from flexarm.cli.main import app

GOOD = """\
flexarm: 1
arm:
  links:
    - {length: 0.6, flexural_rigidity: 5000.0, mass_per_length: 0.4, elements: 1}
    - {length: 0.5, flexural_rigidity: 5000.0, mass_per_length: 0.4, elements: 1}
motion: {kind: line, start: [0.8, 0.2], end: [0.2, 0.8], duration: 0.05}
drive: {kind: rigid_inverse_dynamics}
run: {duration: 0.05, rate: 200}
"""

#: This fixed step is too long for so stiff a link, so the numbers diverge after a few steps.
UNSTABLE = """\
flexarm: 1
arm:
  links:
    - {length: 0.6, flexural_rigidity: 5.0, mass_per_length: 0.4, elements: 2}
motion: {kind: joint, start: [0.0], end: [1.0], duration: 1.0}
drive: {kind: rigid_inverse_dynamics}
run: {duration: 1.0, rate: 5000, integrator: rk4, step: 0.002}
"""


def invoke(*arguments: object) -> Any:
    """Run a command, and raise every exception that flexarm did not handle."""
    return CliRunner().invoke(app, [str(a) for a in arguments], catch_exceptions=False)


def spoiled(old: str, new: str) -> str:
    """Return the valid scenario with one change."""
    assert GOOD.count(old) >= 1
    return GOOD.replace(old, new, 1)


#: Fault, file, and a part of the expected message.
WRONG: dict[str, tuple[str | bytes, str]] = {
    "unknown key": (spoiled("elements", "elments"), "elements"),
    "unknown top-level key": (spoiled("drive", "drives"), "drive"),
    "wrong type": (spoiled("length: 0.6", "length: long"), "arm.links[0].length"),
    "negative": (spoiled("length: 0.6", "length: -0.6"), "greater than 0"),
    "zero": (spoiled("length: 0.6", "length: 0"), "greater than 0"),
    "not a number": (spoiled("length: 0.6", "length: .nan"), "nan"),
    "infinite": (spoiled("length: 0.6", "length: .inf"), "inf"),
    "missing value": (spoiled("length: 0.6, ", ""), "length"),
    "no arm": ("flexarm: 1\nrun: {duration: 1.0}\n", "arm"),
    "empty": ("", "empty"),
    "blank": ("\n  \n", "empty"),
    "binary": (bytes(range(256)), "UTF-8"),
    "not YAML": ("flexarm: [1", "YAML"),
    "a list": ("- 1\n- 2\n", "mapping"),
    "no version": (spoiled("flexarm: 1\n", ""), "flexarm: 1"),
    "newer version": (spoiled("flexarm: 1", "flexarm: 2"), "upgrade"),
    "very many elements": (spoiled("elements: 1", "elements: 1000000"), "at most 256"),
    "out of reach": (spoiled("end: [0.2, 0.8]", "end: [2.0, 0.8]"), "reach"),
    "through the hole": (spoiled("end: [0.2, 0.8]", "end: [-0.8, -0.2]"), "a nearest point of"),
    "unknown drive": (spoiled("rigid_inverse_dynamics", "rigid"), "drive"),
    "unknown integrator": (spoiled("rate: 200", "rate: 200, integrator: euler"), "integrator"),
    "too many samples": (spoiled("rate: 200", "rate: 1.0e+15"), "rate"),
}
