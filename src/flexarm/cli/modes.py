"""``flexarm modes``: natural frequencies and damping at a posture."""

from __future__ import annotations

import math
from pathlib import Path

from flexarm.arm import Arm, load_arm
from flexarm.cli.tables import console, numbers
from flexarm.errors import InputError, Problem, shown
from flexarm.linear import Modes
from flexarm.linear import modes as modes_of
from flexarm.output import check_place, write_text

_WHERE = "flexarm modes"


def show_modes(path: Path, joints: str, angles: str | None, count: int, csv: Path | None) -> None:
    """Print the lowest modes of the arm in a file; write them all to ``csv`` if given.

    Raises:
        InputError: a wrong file, angles that are not numbers or too many or few, a path that
            cannot be written.
    """
    arm = load_arm(path)
    posture = _angles(arm, angles)
    place = None if csv is None else check_place(_WHERE, "--csv", csv, (".csv",))
    found = modes_of(arm, posture, joints)
    angles_text = ", ".join(f"{angle:.4g}" for angle in posture[:8])
    more = ", ..." if arm.joints > 8 else ""
    title = f"Modes with the joints {joints}, at {angles_text}{more} rad"
    screen = console()
    heads = ("mode", "frequency [Hz]", "period [s]", "damping ratio [%]")
    rows = [_row(found, k) for k in range(min(count, found.frequency_hz.size))]
    screen.print(numbers(title, heads, rows))
    if not rows:
        screen.print("none: every link is rigid and every joint is locked")
    if (found.squared_frequency < 0.0).any():
        screen.print("unstable: gravity pulls the arm away from this posture")
    if place is not None:
        write_text(_table(found), place)
        screen.print(f"all {found.frequency_hz.size} modes in {place}")


def _angles(arm: Arm, text: str | None) -> list[float]:
    if text is None:
        return [0.0] * arm.joints
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != arm.joints or not all(math.isfinite(value) for value in values):
        rule = f"be {arm.joints} numbers with commas between, one for each joint (rad)"
        raise InputError(Problem(_WHERE, "--angles", rule, shown(text)))
    return values


def _row(found: Modes, k: int) -> tuple[str, str, str, str]:
    frequency, ratio = found.frequency_hz[k], found.damping_ratio[k]
    if found.squared_frequency[k] < 0.0:
        return str(k + 1), "unstable", "-", "-"
    if frequency == 0.0:
        return str(k + 1), "0 (rigid)", "-", "-"
    return str(k + 1), f"{frequency:.6g}", f"{1.0 / frequency:.4g}", f"{100.0 * ratio:.4g}"


def _table(found: Modes) -> str:
    lines = ["mode,frequency [Hz],damping_ratio [1],squared_frequency [rad^2/s^2]"]
    columns = (found.frequency_hz, found.damping_ratio, found.squared_frequency)
    for number, row in enumerate(zip(*(column.tolist() for column in columns), strict=True), 1):
        lines.append(",".join([str(number), *map(repr, row)]))
    return "\n".join(lines) + "\n"
