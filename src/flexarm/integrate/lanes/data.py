"""Arrays of runs in lanes: coefficients, runs, torques and scratch."""

from __future__ import annotations

from typing import NamedTuple

from flexarm.kernels.compilation.packs import PackArray
from flexarm.kernels.layout import ArmConstants, Array, Contacts, Loads


class StepControl(NamedTuple):
    """Data of a method for the control of its steps."""

    error: Array  # (2, s + 1) weights of the error estimates
    order: int
    adaptive: bool
    longest: float  # rad, largest phase of the fastest mode in a step


class LaneRuns(NamedTuple):
    """Arrays of the runs, by their number in a block."""

    constants: ArmConstants  # with a first axis: one row for all runs, or one for each
    unit: Array  # (1 or runs, 2, n, 1 + m) ``Tolerance.unit`` of the arms
    loads: Loads  # at factor one, with the same first axis except for ``body`` and ``follower``
    contacts: Contacts  # ``rows`` and ``shortening`` with the same first axis, ``law`` with runs
    state: Array  # (runs, 2, n, 1 + m) at the start of each run, then at its end
    fastest: Array  # (runs,) rad/s
    clock: Array  # (runs, CLOCK_PLACES), with the first step
    counts: Array  # (runs, COUNT_PLACES) integers
    status: Array  # (runs,) integers
    sample_times: Array  # (samples,) s
    samples: Array  # (runs, samples, 2, n, 1 + m)
    until: Array  # (runs,) s, end of each run; runs at a later time remain as they are


class LaneDrive(NamedTuple):
    """Torques of all runs, one after another, and their common factors of loads.

    They are piecewise cubics as in ``base.Drive``.
    """

    breaks: Array  # (breaks of all runs,) s
    coefficients: Array  # (pieces of all runs, 4, n)
    stops: Array  # (stops of all runs,) s
    places: Array  # (runs, 6) integers: first and last (excluded) break, piece and stop
    amplitude: Array  # (k, 3) of the loads at factor one
    factor_breaks: Array  # (pieces + 1,) s
    factor_coefficients: Array  # (pieces, 4, k + 2) factors, base acceleration x, y


class LaneContacts(NamedTuple):
    """Contacts of each lane, besides their places on the arm."""

    law: Array  # (LANES, k, LAW_PLACES)
    seen: Array  # (LANES, 2, k, SEEN_COLUMNS)
    motion: PackArray  # (6,) scratch: position and velocity of a point, force on it
    adaptive: bool  # whether steps end where a contact opens or closes


class LaneMemory(NamedTuple):
    """Scratch of one thread.

    If the runs have arms of their own, the first three and the places of the loads have packs
    instead of numbers, and those of a run are copied into its lane.
    """

    constants: ArmConstants
    softened: ArmConstants  # of an implicit step, always with packs of the bodies and modes
    unit: PackArray  # (2, n, 1 + m)
    known: PackArray  # (2, n, 1 + m) implicit state of a stage without its own acceleration
    state: PackArray  # (2, n, 1 + m) at the time of each lane
    new: PackArray  # (2, n, 1 + m) at the end of the present step
    point: PackArray  # (2, n, 1 + m) at which the dynamics is evaluated
    torque: PackArray  # (n,)
    stages: PackArray  # (r, 2, n, 1 + m) derivatives
    step: PackArray  # (1,) s
    norm: PackArray  # (4,) numbers of ``error_sizes`` or ``motion_sizes``; lowest joint inertia
    accepted: PackArray  # (1,) 1.0 in lanes whose step is accepted, otherwise 0.0
    work: PackArray  # ``Workspace`` of packs
    loads: Loads  # packs of ``value`` and ``base_acceleration``; places of the contacts
    contacts: LaneContacts
    weights: Array  # (1, r)
    run: Array  # (LANES,) integers: number of the run, or -1
    fresh: Array  # (LANES,) integers: 1 if the lane needs the derivative at its time
    lands: Array  # (LANES,) integers: 1 if the step ends at a stop
    piece: Array  # (LANES,) integers: piece of the torque at the time of the lane
    end: Array  # (LANES,) s, end of the step
