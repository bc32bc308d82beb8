"""``flexarm modes``: natural frequencies and damping at one posture, or along a range."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

import flexarm as fa
from flexarm.base.errors import InputError, Problem
from flexarm.cli.failures import warn
from flexarm.cli.options import (
    LIST,
    ArmFile,
    Plot,
    Sets,
    changed_document,
    check_places,
    flag,
    joint_numbers,
    listed,
    option,
)
from flexarm.cli.tables import console, numbers, print_line, save_figure

if TYPE_CHECKING:
    from flexarm.linear.vibration.modal import Joints

#: Samples along a range of postures or spins, and stride of the printed rows.
_SAMPLES, _SHOWN_EVERY = 81, 10


#: State of the joints while the arm vibrates.
JointState = Literal["locked", "free"]


def modes(
    arm: ArmFile,
    joints: Annotated[
        JointState | None, typer.Option(help="Condition of the joints; locked by default.")
    ] = None,
    angles: Annotated[
        str | None, option(LIST, "Relative joint angles, rad; zero by default.")
    ] = None,
    proportional: Annotated[
        str | None, option(LIST, "Proportional gains at the joints, N m/rad.")
    ] = None,
    derivative: Annotated[
        str | None, option(LIST, "Derivative gains at the joints, N m s/rad.")
    ] = None,
    sag: Annotated[bool, flag("--sag", "Modes about the equilibrium under gravity.")] = False,
    spin: Annotated[float, option("RATE", "Spin of the whole arm about its base, rad/s.")] = 0.0,
    to: Annotated[str | None, option(LIST, "Track the modes from --angles to these, rad.")] = None,
    campbell: Annotated[
        float | None, option("RATE", "Track the modes from --spin to this spin, rad/s.")
    ] = None,
    count: Annotated[int, typer.Option(min=1, help="Number of modes.")] = 6,
    sets: Sets = None,
    csv: Annotated[Path | None, option("FILE", "Save the modes as a table: .csv.")] = None,
    plot: Plot = None,
) -> None:
    """Show natural frequencies and damping of an arm at rest, or along postures or spins."""
    import numpy as np

    from flexarm.arm.arm import described_arm
    from flexarm.base.errors import kept_warnings
    from flexarm.cases.results import FIGURE_SUFFIXES
    from flexarm.model import load_arm_spec

    model = described_arm(load_arm_spec(changed_document(arm, sets)))
    posture = joint_numbers("--angles", model, angles, "rad")
    condition, text = _joints(model, joints, proportional, derivative)
    check_places(("--csv", csv, (".csv",)), ("--plot", plot, FIGURE_SUFFIXES))
    _check_together(sag, spin, to, campbell)
    if campbell is not None:
        spins = np.linspace(spin, campbell, _SAMPLES)
        tracks = fa.campbell(model, spins, posture, condition, count=count)
        _show_tracks(tracks, text, csv, plot)
    elif to is not None:
        postures = np.linspace(posture, joint_numbers("--to", model, to, "rad"), _SAMPLES)
        tracks = fa.track_modes(model, postures, condition, count=count, sag=sag)
        _show_tracks(tracks, text, csv, plot)
    else:
        with kept_warnings(fa.LargeDeflectionWarning) as warnings:  # printed below
            if model.closure_rows:  # near the angles
                q = fa.assembled(model, model.rest(posture or np.zeros(model.n_joints))).q
                state = fa.equilibrium(model, start=q) if sag else q
                vibration = fa.modes(model, None, condition, q=state)
            else:
                about = fa.equilibrium(model, posture) if sag else posture
                vibration = fa.modes(model, about, condition, spin=spin)
        for warning in dict.fromkeys(text for text, _ in warnings):
            warn(warning)
        place = f", at {listed(posture)} rad" if posture else ""
        turning = f", turning at {spin:g} rad/s" if spin else ""
        title = f"Modes{text}{place}{' sagging' if sag else ''}{turning}"
        _show(vibration, title, count, csv, plot)


def _joints(
    arm: fa.Arm, state: JointState | None, proportional: str | None, derivative: str | None
) -> tuple[Joints, str]:
    """Return the condition of the joints, and its text for a title."""
    if proportional is None and derivative is None:
        word = state or "locked"
        return word, f" with the joints {word}" if arm.n_joints else ", no joint turns"
    if state is not None:
        rule = "cannot be combined with --proportional or --derivative"
        raise InputError(Problem("--joints", rule))
    stiffness = joint_numbers("--proportional", arm, proportional, "N m/rad")
    damping = joint_numbers("--derivative", arm, derivative, "N m s/rad")
    return list(zip(stiffness, damping, strict=True)), " with the joints held by gains"


def _check_together(sag: bool, spin: float, to: str | None, campbell: float | None) -> None:
    """Raise if the arm rotates and options do not permit it."""
    if spin or campbell is not None:
        for name, requested in (("--sag", sag), ("--to", to is not None)):
            if requested:
                raise InputError(Problem(name, "is not supported with a rotating arm"))
    if campbell is not None and campbell <= spin:
        rule = f"be greater than --spin ({spin:g})"
        raise InputError(Problem("--campbell", rule, f"{campbell:g}"))


def _show(vibration: fa.Modes, title: str, count: int, csv: Path | None, plot: Path | None) -> None:
    """Print the lowest modes, and write the requested files."""
    frequencies = vibration.frequency_hz
    heads = ("mode", "frequency [Hz]", "period [s]", "damping ratio [%]")
    rows = [_row(vibration, k) for k in range(min(count, frequencies.size))]
    console().print(numbers(title, heads, rows))
    if not rows:
        print_line("none: every link is rigid and every joint is locked")
    if (vibration.squared_frequency < 0.0).any():
        cause = "the spin" if vibration.spin else "gravity"
        print_line(f"unstable: {cause} pulls the arm away from this posture")
    if csv is not None:
        columns = {
            "mode": range(1, frequencies.size + 1),
            "frequency [Hz]": frequencies.tolist(),
            "damping_ratio [1]": vibration.damping_ratio.tolist(),
            "squared_frequency [rad^2/s^2]": vibration.squared_frequency.tolist(),
        }
        _save_table(columns, csv, f"all {frequencies.size} modes")
    if plot is not None:
        save_figure(fa.plot.modes_figure(vibration, count), plot, "shapes")


def _row(vibration: fa.Modes, k: int) -> tuple[str, str, str, str]:
    frequency, ratio = vibration.frequency_hz[k], vibration.damping_ratio[k]
    if vibration.squared_frequency[k] < 0.0:
        return str(k + 1), "unstable", "-", "-"
    if frequency == 0.0:
        return str(k + 1), "0 (rigid)", "-", "-"
    percent = 100.0 * ratio if abs(ratio) > 1e-12 else 0.0  # rounding of a Coriolis force
    return str(k + 1), f"{frequency:.6g}", f"{1.0 / frequency:.4g}", f"{percent:.4g}"


def _show_tracks(tracks: fa.ModeTracks, joints: str, csv: Path | None, plot: Path | None) -> None:
    """Print every tenth sample of tracked modes, and write the requested files."""
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    name, along = f"{tracks.parameter_name}{unit}", tracks.parameter
    head = name if unit else "way"
    if tracks.parameter_name == "posture":
        head, along = "way", along / along[-1]
    modes = range(tracks.frequency_hz.shape[1])
    rows = [
        [f"{along[k]:.4g}", *(f"{value:.5g}" for value in tracks.frequency_hz[k])]
        for k in range(0, along.size, _SHOWN_EVERY)
    ]
    title = "Frequencies [Hz]" + joints.replace(" with the", ",")
    console().print(numbers(title, [head, *(f"mode {k + 1}" for k in modes)], rows))
    if csv is not None:
        columns = {name: tracks.parameter.tolist()}
        for quantity, values in (
            ("frequency_{} [Hz]", tracks.frequency_hz),
            ("damping_ratio_{} [1]", tracks.damping_ratio),
        ):
            columns |= {quantity.format(k + 1): values[:, k].tolist() for k in modes}
        _save_table(columns, csv, f"all {along.size} samples")
    if plot is not None:
        save_figure(fa.plot.tracks_figure(tracks), plot)


def _save_table(columns: Mapping[str, Sequence[float]], path: Path, content: str) -> None:
    """Write columns as CSV, and print their content and the path."""
    from flexarm.base.writing.places import write_text

    rows = (",".join(map(repr, row)) for row in zip(*columns.values(), strict=True))
    write_text("\n".join([",".join(columns), *rows]) + "\n", path)
    print_line(f"{content} in {path}")
