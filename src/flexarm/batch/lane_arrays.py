"""Arrays of ``integrate.lanes`` for the runs of a batch."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from flexarm.arm import Arm
from flexarm.engine.tolerance import tip_units
from flexarm.histories.piecewise import PiecewiseCubic
from flexarm.integrate.base import FloatArray
from flexarm.integrate.lanes.data import LaneDrive
from flexarm.kernels.layout import ArmConstants


def arms_of_runs(arms: Sequence[Arm]) -> tuple[ArmConstants, FloatArray]:
    """Return constants and units of the tolerance of arms, with the first axis ``arms``."""
    found = [arm.assembly.constants for arm in arms]
    constants = ArmConstants(*(np.stack(arrays) for arrays in zip(*found, strict=True)))
    return constants, np.stack([tip_units(arm) for arm in arms])


def drive_of_runs(arm: Arm, histories: Sequence[PiecewiseCubic]) -> LaneDrive:
    """Join the torques of the runs; equal objects are stored once."""
    different = list({id(history): history for history in histories}.values())
    places, starts = {}, np.zeros(3, dtype=np.int64)
    for history in different:
        sizes = [history.breaks.size, len(history.coefficients), history.stops.size]
        ends = starts + sizes
        places[id(history)] = np.stack([starts, ends], axis=1).ravel()
        starts = ends
    return LaneDrive(
        breaks=np.concatenate([history.breaks for history in different]),
        coefficients=np.concatenate(
            [arm.padded_torque(history.coefficients) for history in different]
        ),
        stops=np.concatenate([history.stops for history in different]),
        places=np.array([places[id(history)] for history in histories]),
    )
