"""``flexarm linearize``: linear model of an arm at an equilibrium, with poles and output files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from flexarm.arm.arm import load_arm
from flexarm.arm.bending import one_warning
from flexarm.base.writing.places import check_place
from flexarm.cases.results import FIGURE_SUFFIXES, MODEL_SUFFIXES, save_linear, write_figure
from flexarm.cli.failures import warn
from flexarm.cli.postures import comma_separated, joint_numbers, listed
from flexarm.cli.tables import console, facts, numbers
from flexarm.linear import LinearModel, equilibrium, linearize

#: Poles below this fraction of the largest are zero to rounding.
_ROUNDING = 1e-7


def show_linear(
    path: Path,
    angles: str | None,
    inputs: str,
    outputs: str,
    count: int,
    out: Path | None,
    plot: Path | None,
) -> None:
    """Print a summary of a linear model and its slowest poles; save the model and its responses.

    Raises:
        InputError: if the file is not valid, a signal is unknown, or a path cannot be written.
        EquilibriumError: if the arm has no equilibrium there.
    """
    arm = load_arm(path)
    posture = joint_numbers("--angles", arm, angles, "rad")
    if out is not None:
        check_place("--out", out, MODEL_SUFFIXES)
    if plot is not None:
        check_place("--plot", plot, FIGURE_SUFFIXES)
    driven, observed = comma_separated(inputs), comma_separated(outputs)
    with one_warning() as kept:  # printed below in one line
        rest = equilibrium(arm, posture)
        model = linearize(arm, rest, inputs=driven, outputs=observed)
    screen = console()
    if warning := next(filter(None, kept), ""):
        warn(warning)
    rows = [
        ("at rest", _held(posture, rest.torque.tolist())),
        ("states", f"{len(model.states)}: {_some(model.states)}"),
        ("inputs", _some(model.inputs)),
        ("outputs", _some(model.outputs)),
    ]
    screen.print(facts(rows))
    screen.print(
        numbers(
            "Poles", ("real [1/s]", "imaginary [1/s]", "[Hz]", "damping [%]"), _poles(model, count)
        )
    )
    if out is not None:
        save_linear(model, out)
        screen.print(f"model in {out}", soft_wrap=True)
    if plot is not None:
        from flexarm.view.plot.vibration import response_figure

        write_figure(response_figure(model), plot)
        screen.print(f"responses in {plot}", soft_wrap=True)


def _held(posture: list[float], torque: list[float]) -> str:
    if not posture:
        return "no joint turns"
    return f"{listed(posture)} rad, held by {listed(torque)} N m"


def _some(names: tuple[str, ...]) -> str:
    return ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")


def _poles(model: LinearModel, count: int) -> list[tuple[str, str, str, str]]:
    """Return the rows of the slowest poles, one per conjugate pair."""
    poles = model.poles
    poles = np.where(np.abs(poles) > _ROUNDING * np.abs(poles).max(initial=0.0), poles, 0.0)
    real = np.where(np.abs(poles.real) > _ROUNDING * np.abs(poles), poles.real, 0.0)
    rows = []
    for pole, part in zip(poles, real, strict=True):
        if pole.imag < 0.0:
            continue
        size = abs(pole)
        ratio = "-" if size == 0.0 else f"{-100.0 * part / size + 0.0:.4g}"
        rows.append((f"{part:.5g}", f"{pole.imag:.6g}", f"{size / (2 * np.pi):.5g}", ratio))
    return rows[:count]
