"""``flexarm modes``: natural frequencies and damping at one posture, or along a range."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from flexarm.arm.arm import Arm, described_arm
from flexarm.arm.bending import one_warning
from flexarm.base.errors import InputError, Problem
from flexarm.base.writing.places import check_place, write_text
from flexarm.cases.results import FIGURE_SUFFIXES, write_figure
from flexarm.cli.failures import warn
from flexarm.cli.postures import at, joint_numbers
from flexarm.cli.tables import console, numbers
from flexarm.linear import Modes, ModeTracks, campbell, equilibrium, track_modes
from flexarm.linear import modes as modes_of
from flexarm.linear.vibration.held import Joints
from flexarm.model import load_arm_spec
from flexarm.model.file_format.changes import change_of, changed
from flexarm.model.file_format.files import load_document

#: Samples along a range of postures or spins, and stride of the printed rows.
_SAMPLES, _SHOWN_EVERY = 81, 10


class ModesOptions(NamedTuple):
    """Options of the command, as given on the command line."""

    joints: str | None
    angles: str | None
    proportional: str | None
    derivative: str | None
    sag: bool
    spin: float
    to: str | None
    campbell_to: float | None
    most: int
    csv: Path | None
    plot: Path | None
    sets: Sequence[str] = ()


def show_modes(path: Path, options: ModesOptions) -> None:
    """Print the lowest modes of the arm in a file, and write the requested output files.

    Raises:
        InputError: if the file is not valid, angles are not one number for each joint, a path
            cannot be written, or options cannot be combined.
        EquilibriumError: if there is no equilibrium under gravity or no steady spin.
    """
    changes = [change_of("--set", text) for text in options.sets]
    arm = described_arm(load_arm_spec(changed(load_document(path), changes)))
    posture = joint_numbers("--angles", arm, options.angles, "rad")
    joints, joints_text = _joints(arm, options)
    for option, place, suffixes in (
        ("--csv", options.csv, (".csv",)),
        ("--plot", options.plot, FIGURE_SUFFIXES),
    ):
        if place is not None:
            check_place(option, place, suffixes)
    _check_together(options)
    if options.to is not None or options.campbell_to is not None:
        _show_tracks(_tracks(arm, posture, joints, options), joints_text, options)
        return
    with one_warning() as kept:  # printed below in one line
        about = equilibrium(arm, posture) if options.sag else posture
        found = modes_of(arm, about, joints, spin=options.spin)
    if warning := next(filter(None, kept), ""):
        warn(warning)
    state = " sagging" if options.sag else ""
    turning = f", turning at {options.spin:g} rad/s" if options.spin else ""
    title = f"Modes{joints_text}{at(posture)}{state}{turning}"
    _show(found, title, options)


def _joints(arm: Arm, options: ModesOptions) -> tuple[Joints, str]:
    """Return the condition of the joints, and its text for a title."""
    if options.proportional is None and options.derivative is None:
        joints = options.joints or "locked"
        return joints, f" with the joints {joints}" if arm.joints else ", no joint turns"
    if options.joints is not None:
        rule = "cannot be combined with --proportional or --derivative"
        raise InputError(Problem("--joints", rule))
    stiff = joint_numbers("--proportional", arm, options.proportional, "N m/rad")
    damping = joint_numbers("--derivative", arm, options.derivative, "N m s/rad")
    return list(zip(stiff, damping, strict=True)), " with the joints held by gains"


def _check_together(options: ModesOptions) -> None:
    turns = bool(options.spin) or options.campbell_to is not None
    if options.sag and turns:
        raise InputError(Problem("--sag", "is not supported with a rotating arm"))
    if options.to is not None and turns:
        raise InputError(Problem("--to", "is not supported with a rotating arm"))
    if options.campbell_to is not None and options.campbell_to <= options.spin:
        rule = f"be greater than --spin ({options.spin:g})"
        raise InputError(Problem("--campbell", rule, f"{options.campbell_to:g}"))


def _tracks(arm: Arm, posture: list[float], joints: Joints, options: ModesOptions) -> ModeTracks:
    if options.campbell_to is not None:
        spin = np.linspace(options.spin, options.campbell_to, _SAMPLES)
        return campbell(arm, spin, posture, joints, count=options.most)
    target = joint_numbers("--to", arm, options.to, "rad")
    way = np.linspace(posture, target, _SAMPLES)
    return track_modes(arm, way, joints, count=options.most, sag=options.sag)


def _show(found: Modes, title: str, options: ModesOptions) -> None:
    screen = console()
    heads = ("mode", "frequency [Hz]", "period [s]", "damping ratio [%]")
    rows = [_row(found, k) for k in range(min(options.most, found.frequency_hz.size))]
    screen.print(numbers(title, heads, rows))
    if not rows:
        screen.print("none: every link is rigid and every joint is locked")
    if (found.squared_frequency < 0.0).any():
        cause = "the spin" if found.spin else "gravity"
        screen.print(f"unstable: {cause} pulls the arm away from this posture")
    if options.csv is not None:
        write_text(_table(found), options.csv)
        screen.print(f"all {found.frequency_hz.size} modes in {options.csv}", soft_wrap=True)
    if options.plot is not None:
        from flexarm.view.plot.vibration import modes_figure

        write_figure(modes_figure(found, options.most), options.plot)
        screen.print(f"shapes in {options.plot}", soft_wrap=True)


def _row(found: Modes, k: int) -> tuple[str, str, str, str]:
    frequency, ratio = found.frequency_hz[k], found.damping_ratio[k]
    if found.squared_frequency[k] < 0.0:
        return str(k + 1), "unstable", "-", "-"
    if frequency == 0.0:
        return str(k + 1), "0 (rigid)", "-", "-"
    percent = 100.0 * ratio if abs(ratio) > 1e-12 else 0.0  # rounding of a Coriolis force
    return str(k + 1), f"{frequency:.6g}", f"{1.0 / frequency:.4g}", f"{percent:.4g}"


def _table(found: Modes) -> str:
    lines = ["mode,frequency [Hz],damping_ratio [1],squared_frequency [rad^2/s^2]"]
    columns = (found.frequency_hz, found.damping_ratio, found.squared_frequency)
    for number, row in enumerate(zip(*(column.tolist() for column in columns), strict=True), 1):
        lines.append(",".join([str(number), *map(repr, row)]))
    return "\n".join(lines) + "\n"


def _show_tracks(tracks: ModeTracks, joints: str, options: ModesOptions) -> None:
    screen = console()
    modes = [f"mode {k + 1}" for k in range(tracks.frequency_hz.shape[1])]
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    way = tracks.parameter
    if tracks.parameter_name == "posture":
        way, unit = tracks.parameter / tracks.parameter[-1], ""
    heads = [f"{'way' if not unit else tracks.parameter_name}{unit}", *modes]
    rows = [
        [f"{way[k]:.4g}", *(f"{value:.5g}" for value in tracks.frequency_hz[k])]
        for k in range(0, way.size, _SHOWN_EVERY)
    ]
    screen.print(numbers("Frequencies [Hz]" + joints.replace(" with the", ","), heads, rows))
    if options.csv is not None:
        write_text(_tracks_table(tracks), options.csv)
        screen.print(f"all {way.size} samples in {options.csv}", soft_wrap=True)
    if options.plot is not None:
        from flexarm.view.plot.vibration import tracks_figure

        write_figure(tracks_figure(tracks), options.plot)
        screen.print(f"plot in {options.plot}", soft_wrap=True)


def _tracks_table(tracks: ModeTracks) -> str:
    count = range(1, tracks.frequency_hz.shape[1] + 1)
    unit = f" [{tracks.parameter_unit}]" if tracks.parameter_unit else ""
    heads = [f"{tracks.parameter_name}{unit}"]
    heads += [f"frequency_{k} [Hz]" for k in count] + [f"damping_ratio_{k} [1]" for k in count]
    columns = [tracks.parameter[:, None], tracks.frequency_hz, tracks.damping_ratio]
    rows = np.concatenate(columns, axis=1).tolist()
    return "\n".join([",".join(heads), *(",".join(map(repr, row)) for row in rows)]) + "\n"
