"""Stress in the links of a run or of the estimates of a filter, and the fatigue that it causes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.arm.stations import MOST_STATIONS
from flexarm.base.arguments import check_count, check_kind, check_mapping, library_missing
from flexarm.base.errors import (
    AccuracyWarning,
    ImplausibleValueWarning,
    InputError,
    Problem,
    check_array,
    public_call,
    shown,
    warn_caller,
)
from flexarm.base.late import xr
from flexarm.control.filters.estimates import Estimates
from flexarm.control.filters.estimator import StateEstimator
from flexarm.integrate.base import FloatArray
from flexarm.model.arm.links import CrossSection, Section
from flexarm.model.paths import with_numbers
from flexarm.model.quantities import Count, Positive
from flexarm.simulation.calls.result import arm_of, make_result
from flexarm.simulation.run.stepping import section_channels

#: Classes of load of the rainflow count: ranges are rounded to this fraction of the largest one.
_CLASSES = 4096
#: Share of the samples of a history that are reversals above which peaks lie between samples: at
#: ten samples a period, two are, and a peak is up to 1 - cos(pi / 10) = 5 % too small.
_REVERSALS = 0.2
#: Classes of load in which reversals are counted for that, so that those of noise are not.
_SEEN = 512
#: Plausible categories of details, Pa: those of EN 1993-1-9 are 36 to 160 MPa.
_CATEGORIES = 1e6, 1e9
#: Ratio of the largest and least flexural rigidity of a link that is no longer uniform.
_TAPERED = 1.05
_SECTION = "a fa.Rectangle, fa.Circle, fa.Tube or fa.Box"


@public_call
def stress(
    run: xr.Dataset | Estimates,
    fibres: ArrayLike = (-1.0, 1.0),
    *,
    sections: Mapping[int, Section] | None = None,
    estimator: StateEstimator | None = None,
    torque: ArrayLike | None = None,
    stations: Count = 11,
) -> xr.DataArray:
    """Return the normal stress in the cross-sections of the links, N / A - M y / I.

    Args:
        run: result of ``simulate(..., stations=k)``, or of a batch of one arm with these channels;
            or the ``Estimates`` of a filter.
        fibres: heights in the section, from -1 to 1 on the side of +y; by default both edges.
        sections: cross-sections by the number of the link, for links without `section`. Links
            that have none are left out.
        estimator: filter of the estimates; its arm with the last estimated payload and parameters
            has the forces, which balance motors, gravity and inertia.
        torque: (samples, joints) N m that the filter received.
        stations: number of sections of each link, for estimates.

    Returns:
        Stress in Pa, tension positive: (time, link, station, fibre).

    Raises:
        InputError: if the result has no forces inside the links, no link has a section, an
            argument is missing, or a fibre is outside.

    Warns:
        AccuracyWarning: if one section is given for a link whose rigidity changes along it.

    Stresses of shear and at notches are not included. Theory page "recursion", (R.40) to (R.43).
    """
    heights = np.atleast_1d(check_array("fibres", fibres, (-1,) * (np.ndim(fibres) > 0)))
    if np.any(np.abs(heights) > 1.0):
        hint = "The edge of a section is at 1, its neutral axis at 0."
        raise InputError(Problem("fibres", "be within -1 and 1", shown(fibres), hint))
    if isinstance(run, Estimates):
        arm, forces = _estimated_forces(run, estimator, torque, stations)
    else:
        forces = check_kind("run", run, xr.Dataset, "a result of simulate, or Estimates")
        arm = _arm_of_forces(forces)
        if estimator is not None or torque is not None:
            name = "estimator" if torque is None else "torque"
            raise InputError(Problem(name, "is for Estimates only: a result has its forces"))
    by_link = _sections(arm, forces["link"].values.tolist(), sections)
    link = {"link": list(by_link)}
    area, second_moment, half = (
        xr.DataArray(list(values), link, ("link",))
        for values in zip(
            *(
                (section.area, section.second_moment, 0.5 * section.depth)
                for section in by_link.values()
            ),
            strict=True,
        )
    )
    fibre = xr.DataArray(heights, {"fibre": heights}, ("fibre",))
    axial, moment = forces["axial_force"].sel(link), forces["bending_moment"].sel(link)
    normal = axial / area - moment * (half / second_moment) * fibre
    return normal.rename("stress").assign_attrs(units="Pa", long_name="normal stress, tension > 0")


def _arm_of_forces(result: xr.Dataset) -> Arm:
    """Return the arm of a result with forces inside the links; InputError if there is none."""
    batch = "run" in result.dims
    if not {"bending_moment", "axial_force"} <= set(result):
        hint = "Simulate with stations=11, for instance."
        if batch:
            hint = f'{hint[:-1]}, and channels=["axial_force", "bending_moment"].'
        raise InputError(Problem("run", "has no forces inside the links", hint=hint))
    varied = any(".section" in str(name) for name in result.variables)
    if batch and ("arm" not in result.attrs or varied):
        hint = "Simulate each arm alone, and call fa.stress for each result."
        raise InputError(Problem("run", "is of several arms, whose sections may differ", hint=hint))
    return arm_of("run", result)


def _estimated_forces(
    estimates: Estimates, estimator: StateEstimator | None, torque: ArrayLike | None, stations: int
) -> tuple[Arm, xr.Dataset]:
    """Return the arm with the last estimates, and the forces inside its links at the samples."""
    if estimator is None or torque is None:
        hint = "Give fa.stress the filter, and the torque that it received."
        missing = "estimator" if estimator is None else "torque"
        raise InputError(Problem(missing, "is missing for Estimates", hint=hint))
    check_count("stations", stations, 2, MOST_STATIONS)
    check_kind("estimator", estimator, StateEstimator, "the filter of the estimates")  # type: ignore[type-abstract]
    last = {path: float(values[-1]) for path, values in estimates.parameters.items()}
    numbers = {"payload.mass": max(float(estimates.payload_mass[-1]), 0.0), **last}
    arm = Arm(with_numbers(estimator.arm.spec, numbers))
    torques = (
        check_array("torque", torque, (len(estimates.q), arm.n_joints)) + estimates.disturbance
    )
    moments = np.zeros((stations, len(torques), arm.n_links, 3))
    for k, (q, qd, acting) in enumerate(zip(estimates.q, estimates.qd, torques, strict=True)):
        qdd = arm.forward_dynamics(q, qd, acting)
        moments[:, k] = arm.section_forces(q, qd, qdd, stations=stations).transpose(1, 0, 2)
    times = np.asarray(np.arange(len(torques)) * estimator.sample_time)
    return arm, make_result(arm, times, section_channels(moments), {})


@public_call
def fatigue_damage(stress: xr.DataArray, detail_category: Positive) -> xr.DataArray:
    """Return the fatigue damage per hour, 1/h, of each point: at 1 its life is used up.

    Args:
        stress: of ``fa.stress``, over a time that repeats in service.
        detail_category: stress range (Pa) that the detail bears two million times.

    Raises:
        InputError: if fatpack is not installed, or the stress has no times.

    Warns:
        AccuracyWarning: if more than a fifth of the samples are peaks or valleys: some are missed.
        ImplausibleValueWarning: if the detail category looks like one of another unit.

    Stress ranges are counted as rainflow cycles, with those that remain open as if the history
    repeated. Damages are added up (Miner) by the curve of EN 1993-1-9, 7.1: slope 3, from five
    million cycles on 5; ranges that a detail bears a hundred million times do no damage. No safety
    factor and no mean stress is applied. Package: fatpack.
    """
    curve, coarse = endurance_curve(detail_category), False
    check_kind("stress", stress, xr.DataArray, "a stress, as fa.stress returns it")
    if "time" not in stress.dims or stress.sizes["time"] < 3:
        raise InputError(Problem("stress", "have at least three times", shown(stress.dims)))
    check_category(detail_category)
    times = stress["time"].values
    hours = float(times[-1] - times[0]) / 3600.0

    def of_history(history: FloatArray) -> float:
        import fatpack

        nonlocal coarse
        check_array("stress", history, history.shape)
        if np.ptp(history) < curve.Sl:  # also a constant one, in which no cycle is found
            return 0.0
        repeated = from_largest(history)
        turns = len(fatpack.find_reversals(repeated, k=_SEEN)[0])
        coarse = coarse or turns > _REVERSALS * len(history)
        ranges = fatpack.find_rainflow_ranges(repeated, k=_CLASSES)
        return float(curve.find_miner_sum(ranges)) / hours

    damage: xr.DataArray = xr.apply_ufunc(
        of_history, stress, input_core_dims=[["time"]], vectorize=True
    )
    if coarse:
        text = "the stress has less than ten samples a cycle, so its peaks are missed and the "
        warn_caller(f"{text}damage is too small: simulate with a higher rate.", AccuracyWarning)
    return damage.rename("damage").assign_attrs(units="1/h", long_name="fatigue damage per hour")


def from_largest(history: FloatArray) -> FloatArray:
    """Return a history that repeats from its largest value to the next one.

    All cycles close within it (ASTM E1049, 5.4.5). fatpack can also close those of other histories,
    and then loses the last turning point of some, which may be the largest (0.7.8).
    """
    largest = int(np.argmax(history))
    return np.concatenate([history[largest:], history[: largest + 1]])


def endurance_curve(detail_category: float) -> Any:
    """Return the endurance curve of a detail; InputError without fatpack."""
    try:
        import fatpack
    except ImportError:
        raise library_missing("fatpack", "fatigue") from None
    return fatpack.TriLinearEnduranceCurve(detail_category)


def check_category(detail_category: float) -> None:
    """Warn of a detail category (Pa) that looks like one of another unit."""
    if not _CATEGORIES[0] <= detail_category <= _CATEGORIES[1]:
        text = f"a detail category of {detail_category:g} Pa is none of a metal; it is in Pa: 71e6."
        warn_caller(text, ImplausibleValueWarning)


def _sections(
    arm: Arm, links: Sequence[int], sections: Mapping[int, Section] | None
) -> dict[int, Section]:
    """Return the cross-sections of those links, by number, that have one."""
    others = check_mapping("sections", {} if sections is None else sections, "links and sections")
    for number, section in others.items():
        if number not in range(1, arm.n_links + 1):
            rule = f"have numbers of links, 1 to {arm.n_links}"
            raise InputError(Problem("sections", rule, shown(number)))
        check_kind(f"sections[{number}]", section, CrossSection, _SECTION)
        rigidity = arm.spec.links[number - 1].beam().flexural_rigidity or (1.0,)
        if max(rigidity) > _TAPERED * min(rigidity):
            warn_caller(
                f"sections[{number}] is one section for the whole of link {number}, whose flexural "
                f"rigidity falls to {min(rigidity) / max(rigidity):.0%} along it: the stress is "
                "that of the link only where it has this section.",
                AccuracyWarning,
            )
    by_link = {number: others.get(number, arm.spec.links[number - 1].section) for number in links}
    if sectioned := {number: section for number, section in by_link.items() if section is not None}:
        return sectioned
    hint = "Give sections={1: fa.Tube(outer_diameter=..., thickness=...)}; fa.varied keeps none."
    raise InputError(Problem("sections", "are missing: no link has one", hint=hint))
