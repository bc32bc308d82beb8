"""Candidates for a task: kinds of controllers, the settings to try, and their margins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.base.errors import FlexarmError, without_warnings
from flexarm.cases.scenario.references import Followed, motion_of
from flexarm.cases.scenario.scenario import prepare
from flexarm.control.analysis.margins import (
    check_single_rate,
    loop_at,
    margins_at,
    places_of,
    stability_of,
    without_friction,
)
from flexarm.control.analysis.sampled_loop import SampledLoop
from flexarm.control.design.arm_scales import NOISE, near_inertias, rigid_inertias
from flexarm.control.design.linear_design import CHORD
from flexarm.control.laws.task_controller import HybridForce, Impedance
from flexarm.integrate.base import FloatArray
from flexarm.model import Scenario
from flexarm.model.checks import checked_arguments
from flexarm.planning.proposals.requirements import Requirements, rounded
from flexarm.simulation.run.progress import Report, unreported

Drive = dict[str, Any]

#: Shortest sample time of MPC, s, whose optimisation needs time of the computer.
_SLOW_SAMPLE_TIME = 0.002
#: Angle (rad) in the delay and the sample time by which the frequency of the loops is limited.
_DELAYED = 0.3
#: Integral feedback relative to the bandwidth: of joint PID, and the most of loop shaping.
_INTEGRAL, _SHAPED_INTEGRAL = 0.25, 0.1
#: Angle (rad) in a sample time below which a pole is at rest, but for rounding.
_RESTING = 1e-5
#: Least delay that a loop must permit, relative to that of the hardware, which it includes; and
#: least damping ratio.
_DELAYS, _DAMPED = 2.0, 0.02
#: Time constants of the slowest pole in which an error falls to a hundredth, and the most periods
#: of the lowest frequency that they may last.
_HUNDREDTH, _MOST_PERIODS = float(np.log(100.0)), 20.0
#: Frequencies of the joint loops, relative to the lowest frequency with locked joints, and their
#: damping ratios. Loops above half of that frequency bend the links more than they move them.
_BANDWIDTHS, _DAMPINGS = (0.15, 0.25, 0.4, 0.6, 1.0, 1.5, 2.5), (0.7, 1.2)
#: Largest derivative gain of a joint loop times its lag, relative to the inertia that a torque
#: turns in it. The damping of the joint itself has no lag.
_NEAR = 0.7
#: Frequencies and damping ratios of the joint loops inside strain feedback, which are stiff.
_INNER, _INNER_DAMPING, _STRAIN_DAMPING = (1.0, 2.0, 3.0), 1.0, (0.3, 0.6)
#: Cutoffs of the bending in redefined outputs, and frequencies of the joint loops inside, likewise.
_REDEFINED, _REDEFINED_BANDWIDTHS = (0.05, 0.15), (0.25, 0.4, 0.6, 1.0)
#: Crossover frequencies of loop shaping, relative to the same frequency.
_CROSSOVERS = (0.2, 0.4, 0.7, 1.1, 1.6)
#: Acceptable deviations of the tip, relative to the length of the arm, and of the rates, relative
#: to the lowest frequency; noise of a measured tip, and acceptable integral of its error times that
#: frequency, relative to the length.
_TIP, _RATE, _TIP_NOISE, _TIP_INTEGRAL = 0.004, 0.0064, 4e-4, 3e-4
#: Acceptable joint angles of arms with more joints than coordinates of the tip, rad.
_ANGLE = 0.01
#: Acceptable angular accelerations relative to the square of that frequency: less than the default,
#: because the designs must be stable with the uncertain payload, too.
_BRISK = 0.04
#: Factors of the acceptable torques and of the noise of the filter: with less torque loops permit
#: more delay, and with more noise they react less to fast modes that differ from the model.
_GENTLE = (
    (1.0, 1.0),
    (0.3, 1.0),
    (0.3, 5.0),
    (0.3, 25.0),
    (0.3, 400.0),
    (0.1, 5.0),
    (0.1, 25.0),
    (0.1, 100.0),
    (0.03, 5.0),
    (0.03, 25.0),
    (0.03, 100.0),
)
#: Least rigidity uncertainty of the designs: the model of a real arm is never exact.
_SOME = 0.1
#: Bandwidths of force loops relative to the lowest frequency with locked joints, which are tried in
#: addition to the default of the law: with elastic joints that is less by a factor of ten.
_FORCE = (0.4, 0.8, 1.4)
#: Factors of the default damping of the tip, which is too high for some surfaces.
_SOFTER = (1.0, 0.3, 0.1)
#: Angle (rad) by which a joint must move so that a design is scheduled over it.
_SCHEDULED = 0.3


#: Error of the tip by sticking joints, relative to the reach, above which loops have an integral.
_STICKING = 1e-4
#: The same error within which a sticking joint is at its goal.
STUCK = 1e-3
#: Names of the joint loops without and with an integral.
_JOINT_LOOPS = "joint PD", "joint PID"


class Candidate(NamedTuple):
    """A kind of controller for a task, the reason, and the settings to try."""

    name: str
    reason: str
    drives: tuple[Drive, ...]


def candidates_of(needs: Requirements) -> list[Candidate]:
    """Return at most three candidates for a task."""
    return list(_of_force(needs) if needs.task == "force" else _of_position(needs))[:3]


def _of_position(needs: Requirements) -> Iterator[Candidate]:
    """Yield the candidates without contact, the most capable one first."""
    seen, model = needs.sensors, needs.computing != "low"
    if model:
        measured = "the tip" if "tip" in seen else "strain gauges"
        measured = measured if {"gauges", "tip"} & seen else "the angles of the joints"
        reason = f"It estimates the bending of the links from {measured} and corrects it."
        yield Candidate("LQG", reason, tuple(_quadratic(needs, "lqg")))
        plans = needs.computing == "high" and needs.torque_limit is not None
        if plans and {"gauges", "tip"} & seen:
            reason = "As LQG, and it plans with the limits of the torques."
            yield Candidate("MPC", reason, tuple(_quadratic(needs, "mpc")))
    if "gauges" in seen and needs.heavy:
        reason = (
            "A joint loop of angles to the tips of the links, which strain gauges show, returns "
            "the tip to its goal whatever the payload is."
        )
        yield Candidate("output redefinition", reason, tuple(_redefined(needs)))
    elif "gauges" in seen:
        reason = (
            "A joint loop with damping by strain gauges needs a filter with one state for each "
            "mode only."
        )
        yield Candidate("integral resonant", reason, tuple(_resonant(needs)))
    if model and not {"gauges", "tip"} & seen:
        reason = (
            "H-infinity loop shaping of the joints has a guaranteed margin, and damps the links "
            "through the joints."
        )
        yield Candidate("loop shaping", reason, tuple(_shaping(needs)))
    reason = "The simplest loop of the joints, along the joint angles of the bent arm."
    loops = (_joint_loop(needs, *pair) for pair in product(_BANDWIDTHS, _DAMPINGS))
    different = {repr(loop): loop for loop in loops}  # the lag limits some to the same
    yield Candidate(_JOINT_LOOPS[_integrates(needs)], reason, tuple(different.values()))


def _of_force(needs: Requirements) -> Iterator[Candidate]:
    """Yield the candidates for a force on a surface."""
    default = HybridForce(needs.arm, **_times(needs)).force_integral
    bandwidths = rounded([default, *np.multiply(_FORCE, _frequency(needs))], 2)
    if "force" in needs.sensors:
        normal = "It controls the measured force normal to the surface and the position along it."
        soft = "A soft spring and damper at the tip, with integral feedback of the force."
        for name, reason, kind in (
            ("hybrid force", normal, HybridForce),
            ("impedance with force", soft, Impedance),
        ):
            drives = tuple(
                _damped(needs, kind, factor) | {"force_integral": bandwidth}
                for factor, bandwidth in product(_SOFTER, bandwidths)
            )
            yield Candidate(name, reason, drives)
    reason = "A soft spring and damper at the tip, which needs no force sensor."
    drives = tuple(_damped(needs, Impedance, factor) for factor in _SOFTER)
    yield Candidate("impedance", reason, drives)


def _damped(needs: Requirements, kind: type[HybridForce] | type[Impedance], factor: float) -> Drive:
    """Return a force controller with its default damping for the delay, times a factor."""
    times = _times(needs)
    usual = vars(kind(needs.arm, **times))
    damping: Drive = {
        name: rounded([factor * usual[name]])[0]
        for name in ("normal_damping", "tangent_damping")
        if name in usual
    }
    return {"kind": kind.name, **damping, **times}


def _times(needs: Requirements) -> dict[str, float]:
    """Return the delay and the sample time (s) for which a force controller has its defaults."""
    return {"delay": float(f"{needs.rate_delay:.3g}"), "sample_time": needs.sample_time}


def _frequency(needs: Requirements) -> float:
    """Return the lowest frequency with locked joints, or that of the motion of a rigid arm.

    Limited by the delay of the hardware.
    """
    limit = _DELAYED / (needs.delay + needs.sample_time)
    return float(min(2.0 * np.pi / needs.period, limit))


def _inertias(needs: Requirements) -> FloatArray:
    """Return the largest inertias (joints,) kg m^2 of the rigid arm along the motion."""
    each = [rigid_inertias(needs.arm, posture) for posture in needs.postures]
    return np.asarray(np.max(each, axis=0))


def _integrates(needs: Requirements) -> bool:
    """Return whether loops need an integral: under gravity, or if joints stick away from the goal.

    A joint sticks where its friction equals the torque of the slowest joint loop.
    """
    friction = needs.arm.assembly.breakaway
    gain = _inertias(needs) * (_BANDWIDTHS[0] * _frequency(needs)) ** 2
    sizes = coordinate_sizes(needs.arm)[needs.arm.joint_index]
    return needs.heavy or float(np.sum(friction / (gain * sizes))) > _STICKING


def _joint_loop(needs: Requirements, factor: float, damping: float) -> Drive:
    """Return joint PD, or joint PID, which knows the limits of the motors."""
    lag, integral = needs.rate_delay + 0.5 * needs.sample_time, _integrates(needs)
    near, inertia = near_inertias(needs.arm, needs.postures, lag), _inertias(needs)
    # The damping of the joint is a part of that of the loop, or all of it: then the proportional
    # gain moves the joint against its damping, with the same slowest pole.
    passive = needs.arm.assembly.least_damping
    most = (_NEAR * near / lag + passive) / (2.0 * damping * inertia)
    omega = np.minimum(factor * _frequency(needs), most)
    total = np.maximum(2.0 * damping * omega * inertia, passive)
    proportional = omega * total / (2.0 * damping)
    drive: Drive = {
        "kind": _JOINT_LOOPS[integral].replace(" ", "_").lower(),
        "proportional": rounded(proportional),
        "derivative": rounded(total - passive),
    }
    if integral:
        drive["integral"] = rounded(_INTEGRAL * omega * proportional)
        if needs.torque_limit is not None:
            drive["torque_limit"] = rounded(needs.torque_limit)
    return drive | {"sample_time": needs.sample_time}


def _resonant(needs: Requirements) -> Iterator[Drive]:
    middle = rounded(needs.postures.mean(axis=0))
    for factor, damping in product(_INNER, _STRAIN_DAMPING):
        yield {
            "kind": "integral_resonant_control",
            "damping_ratio": damping,
            "posture": middle,
            "inner": _joint_loop(needs, factor, _INNER_DAMPING),
        }


def _redefined(needs: Requirements) -> Iterator[Drive]:
    for cutoff, *pair in product(_REDEFINED, _REDEFINED_BANDWIDTHS, _DAMPINGS):
        hertz = float(f"{cutoff * _frequency(needs) / (2.0 * np.pi):.3g}")
        posture, inner = rounded(needs.postures.mean(axis=0)), _joint_loop(needs, *pair)
        yield {"kind": "output_redefinition", "posture": posture, "cutoff": hertz, "inner": inner}


def _shaping(needs: Requirements) -> Iterator[Drive]:
    damped = all(link.damping is not None for link in needs.arm.spec.links if link.flexible)
    integral = _integrates(needs)
    for bandwidth in np.multiply(_CROSSOVERS, _frequency(needs)):
        yield {
            "kind": "loop_shaping",
            "bandwidth": rounded([bandwidth])[0],
            "rigidity_uncertainty": max(_SOME, needs.rigidity) if damped else 0.0,
            "hardware": True,
            **({"integral": rounded([_SHAPED_INTEGRAL * bandwidth])[0]} if integral else {}),
            **_designs(needs),
            "sample_time": needs.sample_time,
        }


def _quadratic(needs: Requirements, kind: str) -> Iterator[Drive]:
    """Yield settings of LQG and MPC, in increasing order of lost performance."""
    reach = needs.arm.reach
    omega = _frequency(needs)
    tip, rate, noise, integral = rounded(
        [_TIP * reach, _RATE * omega, _TIP_NOISE * reach, _TIP_INTEGRAL * reach / omega], 2
    )
    measured = dict(NOISE)
    if "gauges" not in needs.sensors:
        del measured["strain"]
    common: Drive = {
        "acceptable": {"tip": tip, "joint_rate": rate},
        "acceptable_torque": rounded(_BRISK * omega**2 * _inertias(needs)),
    }
    if needs.arm.n_joints > 2:  # the tip does not determine the joints
        common["acceptable"]["joint_angle"] = _ANGLE
    if "tip" in needs.sensors:
        measured["tip"] = noise
        common["integral"] = {"tip": integral}
    elif _integrates(needs):
        common["integral"] = CHORD if "gauges" in needs.sensors else "joint_angle"
    if needs.heavy:  # the reference of a rigid arm would keep the sag
        common["reference"] = "quasi_static"
    common |= {"measured": measured, **_designs(needs), "sample_time": needs.sample_time}
    if needs.torque_limit is not None:
        common["torque_limit"] = rounded(needs.torque_limit)
    if kind == "mpc":
        common["sample_time"] = max(common["sample_time"], _SLOW_SAMPLE_TIME)
    least = max(_SOME, needs.rigidity)
    common["hardware"] = True
    tried = [(least, 0.0), (max(0.3, least), 0.0), (max(0.3, least), 1.0), (1.0, 1.0)]
    torque = np.array(common["acceptable_torque"])
    for gentle, noisy in _GENTLE:
        common["acceptable_torque"] = rounded(gentle * torque)
        common["measured"] = {name: noisy * size for name, size in measured.items()}
        for unsure, recovery in dict.fromkeys(tried if noisy == 1.0 else tried[:1]):
            yield {"kind": kind, "rigidity_uncertainty": unsure, "recovery": recovery, **common}


def _designs(needs: Requirements) -> Drive:
    """Return the posture of a design, and its schedule over the joints that matter most."""
    # Without gravity the dynamics do not depend on the angle of the first joint, but the direction
    # of the tip does. The grid has at most two dimensions.
    first, last = needs.postures[[0, -1]]
    middle = rounded((first + last) / 2.0)
    turned = np.abs(last - first)
    tip = "tip" in needs.sensors
    if not (tip or any(needs.arm.spec.gravity)):
        turned[0] = 0.0
    # Under gravity the sag at each posture belongs to the reference.
    most = np.argsort(-turned)[: 2 if tip or needs.heavy else 1]
    scheduled = [int(joint) for joint in most if turned[joint] >= _SCHEDULED]
    if not scheduled:
        return {"posture": middle}
    schedule: list[Any] = [None] * len(middle)
    for joint in scheduled:
        low, high = sorted((float(first[joint]), float(last[joint])))
        schedule[joint] = rounded(np.linspace(low, high, 3))
    return {"posture": middle, "schedule": schedule}


#: Begin of the failure of refused candidates.
NOT_SIMULATED = "It is not simulated"
#: Margins in tables, and their values for an unstable loop.
_UNSTABLE = {"disk_margin": 0.0, "gain_margin": 1.0, "phase_margin": 0.0, "delay_margin": 0.0}


class Assessed(NamedTuple):
    """A drive with its worst margins over plants and postures."""

    needs: Requirements
    drive: Drive  # as in a file
    margins: dict[str, float]  # by name, growth and damping_ratio, too; SI units
    states: int  # numbers that the controller keeps between samples

    @property
    def stable(self) -> bool:
        """Whether the loop is stable on all plants at all postures."""
        return self.margins["growth"] <= 0.0

    @property
    def refusal(self) -> str:
        """The reason for refusing the loop; empty if it is accepted."""
        margin, ratio = self.margins["delay_margin"], self.margins["damping_ratio"]
        delay, longest = self.needs.delay, _MOST_PERIODS * self.needs.period
        if not self.stable:
            return "is unstable"
        if margin + delay < _DELAYS * delay:
            return (
                f"permits a delay of only {1e3 * (margin + delay):.3g} ms, less than {_DELAYS:g} "
                f"times the {1e3 * delay:.3g} ms of its drive"
            )
        if ratio < _DAMPED:
            return f"has a damping ratio of {ratio:.2g}, less than {_DAMPED:g}"
        decay = -self.margins["growth"]
        if self.needs.task != "force" and decay * longest < _HUNDREDTH:
            time = f"takes {_HUNDREDTH / decay:.2g} s to fall" if decay > 0.0 else "does not fall"
            return (
                f"is too slow: an error {time} to a hundredth, which may take {longest:.2g} s, "
                f"{_MOST_PERIODS:g} periods of the lowest frequency"
            )
        return ""

    @property
    def sticking_time(self) -> float:
        """Longest time (s) in which friction holds a joint that is not at its goal.

        The integral of this error must change the torque by the friction of both directions. Known
        for joint loops only; 0 for others.
        """
        loop = self.drive.get("inner", self.drive)
        if loop.get("kind") != "joint_pid":
            return 0.0
        arm = self.needs.arm
        near = STUCK * coordinate_sizes(arm)[arm.joint_index]
        return float(np.max(2.0 * arm.assembly.breakaway / (near * loop["integral"])))

    @property
    def value(self) -> tuple[bool, bool, bool, float, float]:
        """The value by which settings are compared; larger is better.

        Settings that are not refused come first, then those with the required margin, and among
        them the fastest decay; of the others, the largest margin.
        """
        margins = self.margins
        accepted = not self.refusal
        enough = bool(self.stable and margins["disk_margin"] >= self.needs.disk_margin)
        speed = -margins["growth"]
        return accepted, enough, self.stable, speed if enough else margins["disk_margin"], speed


class Loops:
    """Loops of drives with the plants of a study, in the postures of its motion.

    ``error`` is the text of the last error of a design, or empty.
    """

    def __init__(
        self,
        content: Mapping[str, Any],
        plants: Mapping[str, Arm],
        needs: Requirements,
        drive: Drive,
    ) -> None:
        self._content, self._plants, self._needs = content, plants, needs
        scenario = scenario_of(content, drive)  # all drives share its motion
        self._arm = Arm(scenario.arm)
        self._motion = motion_of(self._arm, scenario)
        self._followed: dict[str | None, Followed] = {}
        self.error = ""

    def assess(self, drive: Drive) -> tuple[Assessed, list[SampledLoop]]:
        """Return a drive with the stability of its loops, and those whose margins are missing.

        Raises FlexarmError if it cannot be designed for the arm.
        """
        scenario = scenario_of(self._content, drive)
        kind = scenario.drive.reference_kind
        known = self._followed.get(kind)
        prepared = prepare(scenario, motion=self._motion, followed=known, arm=self._arm)
        self._followed[kind] = prepared.followed
        controller = prepared.options["controller"]
        contacts = without_friction(scenario.contacts)
        reference: Any = prepared.followed.motion if contacts else None
        times = [reference.start_time, reference.end_time] if contacts else self._needs.postures
        places = places_of(controller, self._arm, times, reference)
        hardware = prepared.options.get("hardware")
        loops = [
            loop_at(controller, plant, posture, hardware, contacts, reference, t)
            for plant in self._plants.values()
            for t, posture in places
        ]
        check_single_rate(loops[0])
        margins, decays = {"growth": -np.inf, "damping_ratio": 1.0}, []
        for loop in loops:
            growth, (hertz, ratio) = stability_of(loop)
            margins["growth"] = max(margins["growth"], growth)
            # Integrators without effect have poles at zero, but for rounding.
            turned = 2.0 * np.pi * hertz * loop.sample_time
            vibrates = (ratio < 1.0 - 1e-9) & (turned > _RESTING)
            decays += [(r * f, r) for r, f in zip(ratio[vibrates], hertz[vibrates], strict=True)]
        margins["damping_ratio"] = float(min(decays, default=(0.0, 1.0))[1])
        found = Assessed(self._needs, drive, margins | _UNSTABLE, len(loops[0].controller.A))
        return found, loops if found.stable else []

    def best(self, candidate: Candidate, report: Report = unreported) -> Assessed | None:
        """Return the best setting of a candidate; None, and ``error``, if none can be designed.

        Margins take time, so that they are computed from the fastest decay on, until one suffices,
        and of each setting until it is not better than another one.
        """
        found = []
        with without_warnings():  # the table shows what they warn of
            for k, drive in enumerate(candidate.drives):
                report(k / len(candidate.drives))
                try:
                    found.append(self.assess(drive))
                except FlexarmError as error:  # no solution of a Riccati equation, no equilibrium
                    self.error = str(error)
        best: Assessed | None = None
        for one, loops in sorted(found, key=lambda pair: pair[0].margins["growth"]):
            # Margins that are not known yet may be as large as possible.
            one.margins.update(dict.fromkeys(_UNSTABLE, np.inf) if loops else {})
            for loop in loops:
                if best and one.value <= best.value:
                    break
                gain, _, phase, late, disk = margins_at(loop)
                of_loop = dict(zip(_UNSTABLE, (disk, gain, phase, late), strict=True))
                worst = {name: min(one.margins[name], np.min(of_loop[name])) for name in of_loop}
                one.margins.update({name: float(value) for name, value in worst.items()})
            if best is None or one.value > best.value:
                best = one
            if all(best.value[:2]):
                break
        return best


def scenario_of(content: Mapping[str, Any], drive: Drive) -> Scenario:
    """Return the scenario of a drive, with the keys of a study that has one motion."""
    shared = {
        name: content[name] for name in ("arm", "loads", "contacts", "hardware") if name in content
    }
    (motion,) = content["motions"].values()
    run = {name: value for name, value in content["run"].items() if name != "settling"}
    return checked_arguments(Scenario, **shared, motion=motion, drive=drive, run=run)
