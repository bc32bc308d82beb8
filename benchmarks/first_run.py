"""Time of the first use of each feature: with the library of kernels, and without compiled kernels.

`python -m benchmarks.first_run` prints only this table, after some minutes.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from benchmarks.startup import Wait, wait
from flexarm.integrate import INTEGRATORS

_ROOT = Path(__file__).resolve().parent.parent
#: First lines of every program. The sizes of the arm do not matter: the same code serves all.
_ARM = """
import numpy as np
import flexarm as fa
from benchmarks.arms import table_one
arm = table_one()
q, zero = arm.rest([0.3, -0.5]), np.zeros(arm.dof)
"""
_FIRST_SIMULATE = "fa.simulate(arm, 0.1, initial=q)"
_FORCE_CONTROL = """
import warnings
hubs = [fa.Joint(hub_inertia=0.1), fa.Joint(hub_inertia=0.05)]
arm = fa.Arm(links=arm.spec.links, joints=hubs)
motion = fa.joint_motion(arm, [0.4, 0.6], [0.5, 0.5], 0.1, start_time=0.5)
x, y, *_ = arm.tip(arm.rest([0.4, 0.6]))
floor = fa.Contact(fa.Wall((float(x), float(y) + 1e-4), (0.0, 1.0)), 1e4)
pressed = fa.pressed_motion(arm, motion, 0.1, [0.0, 1.0], duration=0.1)
controller = fa.HybridForce(arm, frequency=1.5, sample_time=0.004)
with warnings.catch_warnings():
    # The loop is unstable on so flexible an arm; what compiles for it is the same.
    warnings.simplefilter("ignore", fa.FlexarmWarning)
    fa.simulate(arm, 0.01, controller=controller, reference=pressed, contacts=[floor],
                initial=pressed.initial)
"""


class Feature(NamedTuple):
    """A feature, a program that uses it, and the goal for its first use, with process start."""

    name: str
    arguments: tuple[str, ...]  # of Python
    goal: float  # s


def _program(lines: str) -> tuple[str, ...]:
    return "-c", _ARM + lines


def _integrate(name: str) -> str:
    step = "" if INTEGRATORS[name].adaptive else ", step=1e-4"
    return f"fa.simulate(arm, 0.01, initial=q, integrator={name!r}{step})"


class First(NamedTuple):
    """A feature and the time of its first use, with the library and with kernels to compile."""

    feature: Feature
    library: Wait
    wait: Wait


_SIMULATE = Feature("`simulate` with default arguments", _program(_FIRST_SIMULATE), 8.0)
#: Features that a user may begin with: each starts with an empty cache.
ALONE = (Feature("`flexarm paper`", ("-m", "flexarm", "paper"), 15.0), _SIMULATE)
#: Further features: each starts with the machine code of `simulate` and no other.
FURTHER = (
    *(Feature(f"integrator `{name}`", _program(_integrate(name)), 4.0) for name in INTEGRATORS),
    Feature("`linearize` and `modes`", _program("fa.linearize(arm, q); fa.modes(arm)"), 4.0),
    Feature("force control", _program(_FORCE_CONTROL), 4.0),
    Feature(
        "`step_jacobian`",
        _program("fa.step_jacobian(arm, q, zero, [0.0, 0.0], 1e-4)"),
        4.0,
    ),
    Feature("`Arm.derivatives`", _program("arm.derivatives(q, zero, [0.0, 0.0])"), 4.0),
)


def first_uses(
    alone: Sequence[Feature] = ALONE,
    further: Sequence[Feature] = FURTHER,
    after: Feature = _SIMULATE,
) -> list[First]:
    """Time every feature once, each in its own process.

    Args:
        alone: features that start with an empty cache.
        further: features that start with the machine code of ``after``.
        after: the feature that fills the cache for ``further``; it is timed only in ``alone``.
    """
    with tempfile.TemporaryDirectory() as text:
        folder = Path(text)
        found = [
            First(one, _with_library(one, folder), _wait(one, folder, f"alone-{k}"))
            for k, one in enumerate(alone)
        ]
        if further:
            _wait(after, folder, "after")
        for k, one in enumerate(further):
            cache = f"further-{k}"
            shutil.copytree(folder / "after", folder / cache)
            found.append(First(one, _with_library(one, folder), _wait(one, folder, cache)))
        return found


def _wait(feature: Feature, folder: Path, cache: str) -> Wait:
    compiling = {"FLEXARM_CACHE": str(folder / cache), "FLEXARM_KERNELS": "compile"}
    environment = {**os.environ, **compiling, "PYTHONPATH": _path()}
    return wait([sys.executable, *feature.arguments], environment, folder)


def _with_library(feature: Feature, folder: Path) -> Wait:
    """Time a feature with the library, which must have all of its kernels."""
    environment = {**os.environ, "FLEXARM_KERNELS": "library", "PYTHONPATH": _path()}
    return wait([sys.executable, *feature.arguments], environment, folder)


def _path() -> str:
    """Return the search path for packages, with the folder of the benchmarks first."""
    given = os.environ.get("PYTHONPATH")
    return os.pathsep.join([str(_ROOT), *([given] if given else [])])


def main() -> None:
    """Print the table."""
    from benchmarks.report import first_run_table

    print(first_run_table(first_uses()))


if __name__ == "__main__":
    main()
