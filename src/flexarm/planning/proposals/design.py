"""Proposal of a controller for a task: candidates, their margins, their simulations, a scenario."""

from __future__ import annotations

import os
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from flexarm.arm.arm import Arm
from flexarm.base.errors import (
    InputError,
    Problem,
    SimulationError,
    UnstableLoopWarning,
    public_call,
    shown,
    warn_caller,
    without_warnings,
)
from flexarm.base.late import xr
from flexarm.base.writing.places import AnyPath, check_place, write_text
from flexarm.cases.scenario.scenario import prepare
from flexarm.cases.scenario.study import PreparedStudy
from flexarm.control.contract.base import Controller
from flexarm.model import Hardware, PlantSpec, Scenario, StudySpec, file_text
from flexarm.model.quantities import Flag
from flexarm.model.scenarios.study import plant_spec
from flexarm.planning.proposals.candidates import (
    NOT_SIMULATED,
    STUCK,
    Assessed,
    Candidate,
    Loops,
    candidates_of,
    scenario_of,
)
from flexarm.planning.proposals.requirements import (
    AFTER,
    MISSED,
    Requirements,
    case_of,
    quicker,
    requirements_of,
    rounded,
    typical_text,
)
from flexarm.simulation.calls.compare import Evaluation, comparison, runs_of
from flexarm.simulation.calls.metrics import length_text
from flexarm.simulation.loop.stability import NO_INERTIA, with_inertia
from flexarm.simulation.run.progress import Meter, Report, stage, unreported

#: Plants that are simulated: the model, and two that differ from it as far as possible.
_SIMULATED = 3
#: Fractions of the progress when candidates are designed, and when they are simulated.
_DESIGNED, _TRIED = 0.5, 0.9
#: Delays of the hardware that are tried if all candidates are refused, relative to its own.
_SHORTER = (0.5, 0.25, 0.1)
#: Time after the motion in time constants of the slowest pole of a loop.
_TIME_CONSTANTS = 10.0
#: Longest time, in periods of the lowest frequency, in which integrals may release sticking joints.
_STICKING_PERIODS = 100.0
#: Suffixes of scenario files.
SCENARIO_SUFFIXES = (".yaml", ".yml")
#: Metrics whose sum is compared, by task.
SCORES = {
    "hold": ("tip_error_rms",),
    "point_to_point": ("tip_error_settled", "residual_vibration"),
    "track": ("tip_error_rms",),
    "force": ("force_error_rms",),
}
#: Names, units and meanings of the margins in the table.
_LABELS = {
    "disk_margin": ("1", "symmetric disk margin"),
    "gain_margin": ("1", "largest factor on the loop gain"),
    "phase_margin": ("rad", "phase margin"),
    "delay_margin": ("s", "delay margin"),
    "growth": ("1/s", "largest real part of the poles"),
    "damping_ratio": ("1", "damping ratio of the vibration that decays slowest"),
}
_WIDTH = 98


@dataclass(frozen=True, eq=False)
class ControllerDesign:
    """Proposal of a controller for a task, see `flexarm.design`.

    Attributes:
        task: the task.
        chosen: name of the proposed candidate.
        reasons: sentences that explain the proposal.
        table: over ``candidate``: the worst of each margin over plants and postures
            (``disk_margin``, ``gain_margin``, ``phase_margin``, ``delay_margin``, ``growth``,
            ``damping_ratio`` of the vibration that decays slowest) and ``states``, the numbers that
            the controller keeps between samples; over ``candidate`` and ``plant`` the metrics of
            `flexarm.compare`, and ``score``, the sum of those that are compared; NaN for refused
            candidates, which are not simulated unless all are refused.
        scenario: run of the proposed controller on the arm of the model.
        scenarios: the same of all candidates, by name.
        refusal: why the proposal should not be used, or empty; ``save`` then raises.
    """

    task: str
    chosen: str
    reasons: tuple[str, ...]
    table: xr.Dataset
    scenario: Scenario
    scenarios: Mapping[str, Scenario]
    refusal: str = ""

    def __repr__(self) -> str:
        return f"<flexarm.ControllerDesign: {self.chosen} for the task {self.task!r}>"

    @property
    def controller(self) -> Controller:
        """The proposed controller; a new object in each call."""
        arm = Arm(self.scenario.arm)
        made: Controller = prepare(self.scenario, arm=arm).options["controller"]
        return made

    @property
    def text(self) -> str:
        """The scenario as a file, which begins with the reasons as comments."""
        lines = [line for text in self.reasons for line in textwrap.wrap(text, _WIDTH)]
        return "".join(f"# {line}\n" for line in lines) + file_text(self.scenario)

    @public_call
    def save(self, path: AnyPath, overwrite: Flag = False) -> None:
        """Write the scenario file, completely or not at all.

        Args:
            path: the file, which ends in .yaml or .yml.
            overwrite: whether an existing file is replaced.

        Raises:
            InputError: if the file exists, or cannot be written, or the proposal is refused.
        """
        if self.refusal:
            raise InputError(Problem("the proposal", "is refused", hint=self.refusal))
        check_new("path", path, overwrite=overwrite)
        write_text(self.text, path)


def check_new(name: str, path: AnyPath, *, overwrite: bool, hint: str = "") -> None:
    """Raise if a scenario file cannot be written, or exists and is not to be replaced."""
    place = check_place(name, path, SCENARIO_SUFFIXES)
    if not overwrite and os.path.lexists(place):
        hint = hint or "Give another name, or overwrite=True."
        raise InputError(Problem(name, f"{shown(str(place))} already exists", hint=hint))


@public_call
def design(
    arm: Arm,
    task: str,
    *,
    sensors: str | Sequence[str] | None = None,
    computing: str = "medium",
    payload_uncertainty: float = 0.0,
    rigidity_uncertainty: float = 0.0,
    start: ArrayLike | None = None,
    end: ArrayLike | None = None,
    duration: float | None = None,
    torque_limit: ArrayLike | None = None,
    force: float = 5.0,
    disk_margin: float = 0.4,
    hardware: Hardware | None = None,
    progress: bool | None = None,
) -> ControllerDesign:
    """Propose a controller for a task, with its gains, margins and simulations.

    Up to three kinds of controllers are candidates. Several settings of each are linearised with
    the hardware at the start, in the middle and at the end of the motion, for the arm and for arms
    that differ from it as far as the uncertainty permits. The setting with the required margin and
    the fastest decay is simulated on the arm and on two others; the candidate with the least error
    in the worst case is proposed, of errors below 1e-5 of the reach the simplest one; with a force,
    one whose tip settles within 5 % of the path from its goal. Refused are loops that are unstable,
    also with twice the delay of the hardware, whose slowest vibration has a damping ratio below
    0.02, or that need more than 20 periods of the lowest frequency until an error has fallen to a
    hundredth.
    Under gravity, or if dry friction would hold the joints away from the goal, all candidates have
    integral feedback. Under gravity they follow a reference of the bent arm.

    Args:
        arm: the model of the arm.
        task: "hold" a posture while the tip is pushed, "point_to_point" between postures, "track" a
            line with the tip, or press with a "force" on a wall along a line.
        sensors: of "joints" (always), "gauges", "tip" (its position) and "force" (on the surface);
            by default the instruments of ``hardware``, or joints, the gauges of the arm, and for
            the task "force" its sensor.
        computing: "low" permits a few states for each joint, "medium" a model of the flexible arm
            in the controller, "high" an optimisation in each sample if there is a
            ``torque_limit``.
        payload_uncertainty: largest relative error of the payload: 1 for up to twice as much.
        rigidity_uncertainty: largest relative error of the flexural rigidity of the links.
        start, end: joint angles, rad, for "hold" (start only) and "point_to_point"; positions of
            the tip (2,), m, for "track" and "force". By default a motion that suits the arm.
        duration: of the motion, s; by default 2.5 periods of the lowest frequency.
        torque_limit: of the motors, N m, one for all joints or one for each: in all simulations and
            scenarios. LQG, MPC and joint PID also compute with it, or with that of ``hardware``.
        force: on the surface, N.
        disk_margin: required on all arms, see `loop_margins`; if none of the settings of a
            candidate has it, the setting with the largest margin is used.
        hardware: instruments and motors of the machine, in all margins, simulations and scenarios;
            ``Hardware()`` for exact ones. By default those of a typical drive: encoders with 17
            bits, rates through a filter at a tenth of the sampling frequency, and one sample of
            delay; the reasons state them.
        progress: True or False shows or hides the progress bar. By default a terminal shows it, and
            other streams get a line from time to time.

    Raises:
        InputError: if an argument is wrong or does not fit the arm or the task, or the motion
            leaves the reach of the arm.
        EquilibriumError: if the arm has no equilibrium at a posture.
        SimulationError: if no candidate completes its simulation on the arm of the model.

    Warns:
        UnstableLoopWarning: if all candidates are refused; see ``refusal`` of the result.
    """
    needs = requirements_of(
        arm,
        task,
        sensors=sensors,
        computing=computing,
        payload_uncertainty=payload_uncertainty,
        rigidity_uncertainty=rigidity_uncertainty,
        start=start,
        end=end,
        duration=duration,
        torque_limit=torque_limit,
        hardware=hardware,
        force=force,
        disk_margin=disk_margin,
    )
    content = case_of(needs)
    candidates = candidates_of(needs)
    with Meter("designing", progress, lines=True) as meter:
        found, errors = _best(needs, content, candidates, stage(meter.update, 0.0, _DESIGNED))
        if not found:
            rule = "has no controller among the candidates that can be designed for this arm"
            cure = _lacking(needs, found, candidates)
            hint = cure or "Give the links damping, or use other sensors."
            raise InputError(Problem("task", rule, hint=f"{hint} {' '.join(errors.values())}"))
        _wait_until_settled(content, found)
        table = _table(needs, content, found, stage(meter.update, _DESIGNED, _TRIED))
        chosen = _chosen(needs, found, table)
        lacking = _lacking(needs, found, candidates, stage(meter.update, _TRIED, 1.0))
    refusal = _refusal(needs, found, table, chosen, lacking)
    reasons = (*reasons_of(needs, candidates, found, table, chosen), *errors.values())
    reasons = (*reasons, lacking) if lacking and not refusal else reasons
    if refusal:
        reasons = (refusal, *reasons)
        warn_caller(refusal, UnstableLoopWarning)
    scenarios = {name: scenario_of(content, one.drive) for name, one in found.items()}
    proposal = needs.task, chosen, reasons, table, scenarios[chosen], scenarios
    return ControllerDesign(*proposal, refusal)


def _best(
    needs: Requirements,
    content: Mapping[str, Any],
    candidates: Sequence[Candidate],
    report: Report = unreported,
) -> tuple[dict[str, Assessed], dict[str, str]]:
    """Return the best setting of each candidate, and why others cannot be designed, by name."""
    plants = {
        name: Arm(plant_spec(needs.arm.spec, PlantSpec(**factors)))
        for name, factors in content["plants"].items()
    }
    loops = Loops(content, plants, needs, candidates[0].drives[0])
    found, errors = {}, {}
    count = len(candidates)
    for k, candidate in enumerate(candidates):
        best = loops.best(candidate, stage(report, k / count, (k + 1) / count))
        if best is None:
            cause = loops.error.splitlines()[0].rstrip(".")
            errors[candidate.name] = f"{candidate.name} could not be designed: {cause}."
        else:
            found[candidate.name] = best
    return found, errors


def _lacking(
    needs: Requirements,
    found: Mapping[str, Assessed],
    candidates: Sequence[Candidate],
    report: Report = unreported,
) -> str:
    """Return a change with which the simplest candidate, the last one, is accepted.

    Empty if it is accepted without a change, or with none of those that are tried.
    """
    name = candidates[-1].name
    if name in found and not found[name].refusal:
        return ""
    refused = bool(found) and all(each.refusal for each in found.values())
    cures = list(_cures(needs, refused))
    for k, (cured, cure) in enumerate(cures):
        more = stage(report, k / len(cures), (k + 1) / len(cures))
        best, _ = _best(cured, case_of(cured), candidates_of(cured)[-1:], more)
        if best and not best[name].refusal:
            return f"{cure}, {name} is accepted."
    return ""


def _cures(needs: Requirements, refused: bool) -> Iterator[tuple[Requirements, str]]:
    """Yield other requirements and their difference: inertia, and if all are ``refused``, more."""
    for arm, inertia in with_inertia(needs.arm):
        yield replace(needs, arm=arm), f"{NO_INERTIA} with {inertia}"
    if refused:
        if needs.payload or needs.rigidity:
            exact = replace(needs, payload=0.0, rigidity=0.0)
            yield exact, "Without the uncertainty of payload and rigidity"
        for factor in _SHORTER * (needs.delay > 0.0):
            quick = replace(needs, hardware=quicker(needs.hardware, factor))
            yield quick, f"With {1e3 * quick.delay:.2g} ms of delay and lag of the hardware"


def _wait_until_settled(content: dict[str, Any], found: Mapping[str, Assessed]) -> None:
    """Extend the runs until the loops have settled, and measure the error after that."""
    run = content["run"]
    if {"point_to_point", "track"} & content["motions"].keys():
        accepted = [one for one in found.values() if not one.refusal]
        decay = min((-one.margins["growth"] for one in accepted), default=np.inf)
        least = run["settling"] * AFTER
        longest = _STICKING_PERIODS * least / AFTER
        sticking = max((min(one.sticking_time, longest) for one in accepted), default=0.0)
        time = float(f"{max(_TIME_CONSTANTS / decay, sticking):.2g}")
        end, after = run["duration"] - least, max(least, time)
        content["run"] = run | {
            "duration": rounded([end + after], 6)[0],
            "settling": float(f"{after * (1.0 - 1.0 / AFTER):.2g}"),
        }


def _table(
    needs: Requirements,
    content: dict[str, Any],
    found: Mapping[str, Assessed],
    report: Report,
) -> xr.Dataset:
    """Return the margins of the candidates, and the metrics of their simulations.

    Refused candidates are not simulated, unless the best one is refused, too.
    """
    ranks = {name: _rank(one) for name, one in found.items()}
    accepted = (name for name, one in found.items() if not one.refusal)
    simulated = list(accepted) or [name for name in found if ranks[name] == min(ranks.values())]
    drives = {name: found[name].drive for name in simulated}
    plants = dict(list(content["plants"].items())[:_SIMULATED])

    def evaluations(runs: Sequence[Sequence[str]]) -> Iterator[Evaluation]:
        for k, (name, *run) in enumerate(runs):
            report(k / len(runs))
            if name in drives:
                yield study.evaluation(name, *run)
            else:
                yield Evaluation(failure=f"{NOT_SIMULATED}, because it {found[name].refusal}.")

    with without_warnings():  # the table has the warnings of the runs
        study = PreparedStudy(StudySpec(**{**content, "plants": plants}, drives=drives))
        names = study.names | {"controller": list(found)}
        runs = comparison(names, evaluations(runs_of(names)), progress=False)
    table = runs.isel(reference=0, drop=True).rename(controller="candidate")
    first, *others = SCORES[needs.task]
    score = sum((table[name] for name in others), table[first]).where(table["failure"] == "")
    nominal = {"plant": next(iter(plants))}
    if score.sel(nominal).isnull().all():
        reason = "no candidate completes its simulation on the arm of the model."
        cause = table["failure"].sel(nominal).sel(candidate=simulated[0])
        raise SimulationError(0.0, reason, str(cause.values))
    unit = table[first].attrs["units"]
    table["score"] = score.assign_attrs(units=unit, long_name="error that is compared")
    for name, (unit, meaning) in _LABELS.items():
        values = [one.margins[name] for one in found.values()]
        labels = {"units": unit, "long_name": f"{meaning}, worst case"}
        table[name] = ("candidate", values, labels)
    labels = {"units": "1", "long_name": "numbers that the controller keeps between samples"}
    table["states"] = ("candidate", [one.states for one in found.values()], labels)
    return table


def _chosen(needs: Requirements, found: Mapping[str, Assessed], table: xr.Dataset) -> str:
    """Return the candidate of least worst error, with the margin or stable on all arms first.

    With a force, an accepted one whose tip settles at its goal is before one with the margin. Of
    errors that the simulation does not resolve, the simplest candidate, which is the last one.
    """
    resolved = 0.0 if needs.task == "force" else _RESOLVED * needs.arm.reach
    worst = table["score"].fillna(np.inf).max("plant").clip(min=resolved)

    def cost(name: str) -> tuple[Any, ...]:
        far = _tip_of(needs, table, name) > needs.farthest
        rank = _rank(found[name])
        return rank[0], far, rank, float(worst.sel(candidate=name))

    return min(reversed(list(found)), key=cost)


def _tip_of(needs: Requirements, table: xr.Dataset, name: str) -> float:
    """Return the largest settled error (m) of the tip on a surface; 0 without a force."""
    if needs.task != "force":
        return 0.0
    return float(table["tip_error_settled"].sel(candidate=name).max())


def _rank(one: Assessed) -> tuple[bool, ...]:
    """Return the rank of a candidate by its margins; less is better, whatever its errors are."""
    return tuple(not reached for reached in one.value[:3])


def _refusal(
    needs: Requirements,
    found: Mapping[str, Assessed],
    table: xr.Dataset,
    chosen: str,
    lacking: str = "",
) -> str:
    """Return why the best candidate is refused; empty if it is not."""
    hint = lacking or "Reduce the uncertainty or the delays, or add sensors or damping."
    if all(not one.stable for one in found.values()):
        return f"No candidate is stable on {_arms(needs)}. {hint}"
    if refusal := found[chosen].refusal:
        return f"No candidate is accepted: {chosen}, the best one, {refusal}. {hint}"
    score = table["score"].sel(candidate=chosen)
    if score.isnull().any():
        return f"No candidate is accepted: {chosen} does not complete its runs. {hint}"
    best = f"No candidate is accepted: {chosen}, the best one, is stable in the linear model, but "
    if (tip := _tip_of(needs, table, chosen)) > needs.farthest:
        other = ", or measure the force: hybrid force has an integral along the surface"
        return (
            f"{best}its tip settles {length_text(tip)} from its goal, more than {MISSED:.0%} of "
            f"the path. Reduce the uncertainty{other * ('force' not in needs.sensors)}."
        )
    if needs.task != "force" and score.max() > needs.farthest:
        return (
            f"{best}its error ({_ERRORS[needs.task]}) is {_amount(needs, float(score.max()))}, "
            f"more than {MISSED:.0%} of the reach. Give the motion more time, or the motors more "
            "torque."
        )
    return ""


#: Error of the tip, relative to the reach, that a run by default does not resolve.
_RESOLVED = 1e-5
#: Share of a run with a motor at its limit above which the reasons mention it.
_LIMITED = 0.1


_ERRORS = {
    "hold": "RMS error of the tip",
    "point_to_point": "settled error and residual vibration of the tip",
    "track": "RMS error of the tip",
    "force": "RMS error of the force",
}


def reasons_of(
    needs: Requirements,
    candidates: Sequence[Candidate],
    found: Mapping[str, Assessed],
    table: xr.Dataset,
    chosen: str,
) -> tuple[str, ...]:
    """Return the sentences that explain a proposal."""
    worst = table["score"].max("plant", skipna=False)
    reason = next(one.reason for one in candidates if one.name == chosen)
    result = _result(needs, table, chosen)
    sentences = [f"{chosen} for the task {needs.task}: {result}. {reason}"]
    for name in found:
        if name != chosen:
            tip = _tip_of(needs, table, name)
            error = float(worst.sel(candidate=name))
            sentences.append(_other(needs, name, found[name], error, tip))
    if found[chosen].stable:
        margins = found[chosen].margins
        places = "at the start, in the middle and at the end of the motion"
        if needs.task == "hold":
            places = "in its posture"
        text = (
            f"On {_arms(needs)}, {places}, the loop of each joint "
            f"permits a gain factor of {margins['gain_margin']:.2g}, "
            f"{np.degrees(margins['phase_margin']):.0f} degrees of phase and "
            f"{1e3 * margins['delay_margin']:.2g} ms of delay (disk margin "
            f"{margins['disk_margin']:.2g}). The slowest vibration has a damping ratio of "
            f"{margins['damping_ratio']:.2g}."
        )
        if margins["disk_margin"] < needs.disk_margin:
            text += f" No candidate has the required disk margin of {needs.disk_margin:g}."
        sentences.append(text)
    if time := found[chosen].sticking_time:
        sentences.append(
            f"Until the tip is within {STUCK:.1%} of the reach of its goal, dry friction may hold "
            f"the joints for {time:.2g} s, which the integral needs to release them."
        )
    share = float(table["saturation"].sel(candidate=chosen).max())
    if share > _LIMITED:
        sentences.append(
            f"A motor is at its limit for {share:.0%} of a run: give the motion more time, or the "
            "arm stronger motors."
        )
    return (*sentences, *_advice(needs))


def _result(needs: Requirements, table: xr.Dataset, chosen: str) -> str:
    """Return the error of the proposal on the simulated arms, or the arms on which it fails."""
    score = table["score"].sel(candidate=chosen)
    failed = score["plant"].values[np.isnan(score.values)]
    if failed.size:
        return f"it does not complete its run on {' and '.join(map(repr, map(str, failed)))}"
    amount, tip = _amount(needs, float(score.max())), _tip_of(needs, table, chosen)
    settled = f", settled error of the tip at most {length_text(tip)}," * (needs.task == "force")
    return f"{_ERRORS[needs.task]} at most {amount}{settled} on the simulated arms"


def _other(needs: Requirements, name: str, one: Assessed, worst: float, tip: float) -> str:
    """Return why another candidate is not proposed, or how near it is."""
    if refusal := one.refusal:
        return f"{name} {refusal}{' on one of the arms' * (not one.stable)}."
    if not np.isfinite(worst):
        return f"{name} does not complete its run on one of the arms."
    text = f"{name}: {_amount(needs, worst)}"
    if needs.task == "force":
        left = f", more than {MISSED:.0%} of the path" * (tip > needs.farthest)
        text += f", and the tip settles {length_text(tip)} from its goal{left}"
    if one.margins["disk_margin"] < needs.disk_margin:
        text += f", with a disk margin of only {one.margins['disk_margin']:.2g}"
    return text + "."


def _arms(needs: Requirements) -> str:
    """Return the arms on which loops are analysed, in words."""
    if needs.payload or needs.rigidity:
        return "all arms within the uncertainty that were tried"
    return "the model"


def _advice(needs: Requirements) -> Iterator[str]:
    """Yield assumptions, and what would permit better controllers."""
    if needs.typical:
        yield typical_text(needs.hardware)
    free = needs.task != "force"
    if free and needs.computing == "low" and needs.lowest:
        yield (
            "With more computing power, an observer of the bending (LQG) is a candidate: "
            'computing="medium".'
        )
    if free and needs.lowest and not {"gauges", "tip"} & needs.sensors:
        yield "Strain gauges near the roots of the links would show the bending to the controller."
    if needs.computing == "high" and needs.torque_limit is None and free:
        yield "MPC is not a candidate without torque_limit."
    if needs.task == "track" and (needs.payload or needs.rigidity):
        yield "If the motion repeats, iterative learning removes the errors of an uncertain arm."
    if not (needs.payload or needs.rigidity):
        yield "The arm is taken as exact: give the uncertainty of its payload and rigidity."


def _amount(needs: Requirements, error: float) -> str:
    return f"{error:.3g} N" if needs.task == "force" else length_text(error)
