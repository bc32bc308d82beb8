"""``flexarm linearize``: linear model of an arm at an equilibrium, with poles and output files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Annotated

import typer

import flexarm as fa
from flexarm.cli.failures import warn
from flexarm.cli.options import (
    Angles,
    ArmFile,
    Inputs,
    Outputs,
    check_places,
    comma_separated,
    joint_numbers,
    listed,
    option,
)
from flexarm.cli.tables import console, facts, numbers, print_line, save_figure

#: Poles below this fraction of the largest are zero to rounding.
_ROUNDING = 1e-7


def linearize(
    arm: ArmFile,
    angles: Angles = None,
    inputs: Inputs = "torque",
    outputs: Outputs = "joint_angle,tip",
    count: Annotated[int, typer.Option(min=1, help="Number of poles to print.")] = 8,
    out: Annotated[Path | None, option("FILE", "Save the model: .mat or .json.")] = None,
    plot: Annotated[Path | None, option("FILE", "Save the responses: .png, .pdf or .svg.")] = None,
) -> None:
    """Compute a linear model of an arm at rest: A, B, C, D and their poles."""
    from flexarm.base.errors import kept_warnings
    from flexarm.cases.results import FIGURE_SUFFIXES, MODEL_SUFFIXES

    loaded = fa.load_arm(arm)
    posture = joint_numbers("--angles", loaded, angles, "rad")
    check_places(("--out", out, MODEL_SUFFIXES), ("--plot", plot, FIGURE_SUFFIXES))
    driven, observed = comma_separated(inputs), comma_separated(outputs)
    with kept_warnings(fa.LargeDeflectionWarning) as warnings:  # printed below
        rest = fa.equilibrium(loaded, posture)
        model = fa.linearize(loaded, rest, inputs=driven, outputs=observed)
    for warning in dict.fromkeys(text for text, _ in warnings):
        warn(warning)
    torque = listed(rest.torque.tolist())
    rows = [
        (
            "at rest",
            f"{listed(posture)} rad, held by {torque} N m" if posture else "no joint turns",
        ),
        ("states", f"{len(model.states)}: {_some(model.states)}"),
        ("inputs", _some(model.inputs)),
        ("outputs", _some(model.outputs)),
    ]
    screen = console()
    screen.print(facts(rows))
    heads = ("real [1/s]", "imaginary [1/s]", "[Hz]", "damping [%]")
    screen.print(numbers("Poles", heads, islice(_poles(model), count)))
    if out is not None:
        fa.save_linear(model, out)
        print_line(f"model in {out}")
    if plot is not None:
        save_figure(fa.plot.response_figure(model), plot, "responses")


def _some(names: Sequence[str]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")


def _poles(model: fa.LinearModel) -> Iterator[tuple[str, str, str, str]]:
    """Yield the rows of the poles, the slowest first, one per conjugate pair."""
    import numpy as np

    poles = model.poles
    poles = np.where(np.abs(poles) > _ROUNDING * np.abs(poles).max(initial=0.0), poles, 0.0)
    reals = np.where(np.abs(poles.real) > _ROUNDING * np.abs(poles), poles.real, 0.0)
    for pole, real in zip(poles, reals, strict=True):
        if pole.imag < 0.0:
            continue
        size = abs(pole)
        ratio = "-" if size == 0.0 else f"{-100.0 * real / size + 0.0:.4g}"
        yield f"{real:.5g}", f"{pole.imag:.6g}", f"{size / (2 * np.pi):.5g}", ratio
