"""Effects that residuals show and the model lacks: friction, backlash, offsets, delays, gains.

Each effect but backlash is tested as a signal that is added to an input or to an output, so that
its change of the outputs is computed without a new arm. The test is the score test with the
correlation of residuals over time (Breusch and Pagan, Review of Economic Studies 47 (1980) 239;
Newey and West, Econometrica 55 (1987) 703): the part of the change that no estimate can reproduce
is compared with the residuals. The estimates of a model that has the effect are those of a new fit.
"""

from __future__ import annotations

import re
from collections.abc import Container, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.base.errors import FlexarmError
from flexarm.identification.data_sheet import driven_joints, of_drives, of_masses
from flexarm.identification.fitting import COARSE, Fit, FitFailure, FitProblem, fit_from
from flexarm.identification.input_noise import with_input_noise
from flexarm.identification.prediction import PredictedRun
from flexarm.identification.record import MEASURED, Label, check_label, units_of
from flexarm.identification.result import SIGNIFICANT
from flexarm.identification.runs import RecordRun
from flexarm.identification.space import (
    Case,
    error_paths,
    in_words,
    least_error,
    of_input_delay,
    of_records,
    stated_delay,
    with_joint,
    without_error,
)
from flexarm.identification.statistics import (
    Column,
    coloured_information,
    covariance_of,
    whiteness,
)
from flexarm.integrate.base import FloatArray
from flexarm.model import ArmSpec, Friction, Joint
from flexarm.model.paths import number_at, with_number
from flexarm.simulation.run.channels import SLIDING

#: Size of added inputs, as a fraction of the largest input.
_SIZE = 0.01
#: Least deviations by which an effect differs from zero, least share of the squared residuals that
#: it explains, and least part of its change that no estimate reproduces.
_DEVIATIONS, _SHARE, _DISTINCT = 3.5, 0.1, 1e-6
#: Blocks of the records, and least deviations by their scatter (95 % of t for eight of them).
_BLOCKS, _CONSISTENT = 8, 2.36
#: Most effects that are named, and half the width of a 95 % interval in standard deviations.
_MOST, HALF = 3, 1.96
#: For a rigid joint with backlash: vibration of its gear relative to the rate of the record, part
#: of the critical damping, and part of the hub's inertia that is the motor's if none is given.
_GEAR, _DAMPED, _MOTOR = 0.25, 0.5, 0.4
#: Least power of residuals, as a fraction, that a fit of all but backlash must leave if a gap is
#: named, and most evaluations of fits with effects. Gaps leave 0.74 to 0.88, records without one
#: at most 0.3.
_LEFT, _EVALUATIONS = 0.5, 24
#: Rates below which friction is smooth, and over which Stribeck friction decays at first, as
#: fractions of the largest joint rate.
_SMOOTH, _STRIBECK = 0.02, 0.1
#: Paths of effects in a joint.
OF_JOINT = re.compile(r"joints\[(\d+)\]\.(friction\.coulomb|friction\.static|backlash)$")


class Effect(NamedTuple):
    """Effect that the model lacks."""

    sentence: str
    shift: FloatArray  # (parameters,) change of the estimates in a model that has it
    path: str = ""  # of the parameter that describes it, if there is one
    size: float = 0.0  # of the effect, SI units; of a gain, its relative error
    test: tuple[_Candidate, float] | None = None  # with the share of the residuals' power


class _Candidate(NamedTuple):
    """Effect to test: its change of the weighted outputs, for a size of one unit."""

    path: str
    unit: str
    columns: list[FloatArray]  # (samples,) of each column of residuals
    positive: bool = False  # whether a negative size has no meaning
    stated: bool = False  # whether it is an error of a delay that the record states


def effect_name(path: str, short: bool = False) -> str:
    """Return the name of an effect in sentences and, if ``short``, in tables."""
    kind, _, text = path.partition(".")
    words = in_words(path).replace("coulomb", "Coulomb").replace("static", "Stribeck")
    if kind == "drifts":
        words = f"drift of {text}"
    if kind == "gains" and not short:
        return f"a relative error of the gain of {text}"
    article = "" if short or path.startswith("joints[") else "an " if kind == "offsets" else "a "
    return article + words


def missing_effects(
    problem: FitProblem,
    fit: Fit,
    columns: Sequence[Column],
    priors: FloatArray,
    most: int = _MOST,
) -> list[Effect]:
    """Return the effects that residuals show and the model lacks, the largest first.

    ``columns`` are those of the fit, ``priors`` (parameters,) inverse variances. Prediction errors
    are not tested: a filter follows effects.
    """
    if any(isinstance(run, PredictedRun) for run in problem.runs):
        return []
    candidates = _candidates(problem, fit)
    scale = problem.space.scale
    slopes = np.concatenate([column.derivatives for column in columns]) * scale
    residuals = np.concatenate([column.residuals for column in columns])
    basis, triangle = np.linalg.qr(slopes)
    total, chosen = float(residuals @ residuals), list[tuple[_Candidate, float]]()
    while candidates and total > 0.0 and len(chosen) < most:
        rest = residuals - basis @ (basis.T @ residuals)
        tests = [_test(candidate, columns, basis, rest, total) for candidate in candidates]
        best = int(np.argmax([share for share, _ in tests]))
        share, direction = tests[best]
        if share < _SHARE:
            break
        if _is_gap(candidates[best]) and _left_without_gap(problem, fit) < _LEFT * total:
            candidates = [candidate for candidate in candidates if not _is_gap(candidate)]
            continue
        basis = np.column_stack([basis, direction])
        chosen.append((candidates.pop(best), share))
    if not chosen:
        return []
    changes = np.stack([np.concatenate(each.columns) for each, _ in chosen], axis=1)
    apart = changes - basis[:, : len(scale)] @ (basis[:, : len(scale)].T @ changes)
    sizes = np.linalg.lstsq(apart, residuals, rcond=None)[0]
    # The priors resist the change of the estimates as further rows of the derivatives.
    rows = np.vstack([triangle, np.diag(np.sqrt(priors) * scale)])
    inverse = np.linalg.pinv(rows)[:, : len(scale)]
    shifts = scale[:, None] * (inverse @ (basis[:, : len(scale)].T @ (changes * sizes)))
    return [
        Effect(_sentence(*test, size), shift, test[0].path, float(size), test)
        for test, size, shift in zip(chosen, sizes, shifts.T, strict=True)
        # Together, effects may leave a size without meaning for one that was positive alone.
        if size > 0.0 or not test[0].positive
    ]


def _is_gap(candidate: _Candidate) -> bool:
    return candidate.path.endswith("backlash")


def _left_without_gap(problem: FitProblem, fit: Fit) -> float:
    """Return the squared residuals of a fit of everything but backlash.

    Where a parameter is wrong or an effect is missing, the residuals of a fit are far from linear
    in it, so that a gap may resemble them more than the effect does. Zero if the fit fails.
    """
    runs, case = problem.runs, problem.space.case(None, fit.vector)
    spec, rates = case.spec, smoothing_rates(runs, case)
    paths = [path for run in runs for path in error_paths(run.record) if run.record.input in path]
    for index, rate in zip(driven_joints(spec), rates, strict=True):
        if rate > 0.0 and not ((f := spec.joints[index].friction) and f.coulomb):
            spec = with_coulomb(spec, index, _SIZE * np.abs(runs[0].samples).max(), rate)
    prescribed = set.intersection(*(set(run.record.settings.prescribed) for run in runs))
    paths += [*of_drives(spec, case.motors, prescribed), *of_masses(spec)]
    try:
        rival, best = _fit_of_wider(
            problem, fit, case._replace(spec=spec), paths, "linear", loose=True
        )
        return float(np.sum(rival.weighted(best.vector, best.outputs) ** 2))
    except (FitFailure, FlexarmError):
        return 0.0


def _fit_of_wider(
    problem: FitProblem, fit: Fit, case: Case, paths: Sequence[str], loss: str, loose: bool
) -> tuple[FitProblem, Fit]:
    """Return a coarse fit from a case with further free numbers, and its problem.

    ``loose``: without bounds and priors.
    """
    rival = FitProblem(problem.space.wider(case, paths, loose), problem.runs, None, problem.noise)
    slots = zip(problem.space.slots, fit.vector.tolist(), strict=True)
    estimates = {slot.name: value for slot, value in slots}
    start = [estimates.get(slot.name, slot.start) for slot in rival.space.slots]
    return rival, fit_from(rival, np.array(start), loss, _EVALUATIONS, COARSE)


class Completed(NamedTuple):
    """Effects that a model lacks, and its estimates with them."""

    effects: list[Effect]
    vector: FloatArray  # (parameters,) estimates of the parameters of the model
    covariance: FloatArray  # (parameters, parameters), with the change by an effect not fitted


def completed(
    problem: FitProblem, fit: Fit, columns: Sequence[Column], priors: FloatArray, loss: str
) -> Completed:
    """Return the effects that residuals show, and the estimates of a model that has them.

    After each effect all parameters are fitted with it, and the residuals of that fit tested: the
    change of estimates far from the true ones is not linear, and residuals resemble several
    effects. ``columns`` and ``priors`` as in ``missing_effects``.
    """
    rival, best, effects = problem, fit, list[Effect]()
    free = [slot.path for slot in problem.space.slots]
    covariance = covariance_of(columns, priors)
    while len(effects) < _MOST:
        new = missing_effects(rival, best, columns, priors, 1)
        if not new or new[0].path in {*free, *(effect.path for effect in effects)}:
            break
        effects += new
        try:
            rival, best, columns, priors = _fit_with(rival, best, covariance, new, loss)
            covariance = covariance_of(columns, priors)
        except (FitFailure, FlexarmError):
            covariance = covariance + np.outer(new[0].shift, new[0].shift)
            break
    names = [slot.name for slot in rival.space.slots]
    whole = rival.space.case(None, best.vector)
    effects = [_resized(each, whole) if each.path in names else each for each in effects]
    places = [names.index(slot.name) for slot in problem.space.slots]
    return Completed(effects, best.vector[places], covariance[np.ix_(places, places)])


def _fit_with(
    problem: FitProblem, fit: Fit, covariance: FloatArray, effects: Sequence[Effect], loss: str
) -> tuple[FitProblem, Fit, list[Column], FloatArray]:
    """Return the problem of a fit with effects, the fit, and its columns and priors.

    FitFailure if no parameter describes the effects.
    """
    space, case = problem.space, problem.space.case(None, fit.vector)
    if not all(can_join(case.spec, effect.path) for effect in effects):
        raise FitFailure("no parameter describes an effect")
    half, (lower, upper) = HALF * np.sqrt(np.diag(covariance)), space.bounds
    if np.any((fit.vector - half < lower) | (fit.vector + half > upper)):
        # Near a bound, such as one of damping, the derivatives are those of another motion.
        fit = replace(fit, vector=space.start)
    rates = smoothing_rates(problem.runs, case)
    case, paths = joined(space.case(None, fit.vector), effects, rates)
    rival, best = _fit_of_wider(problem, fit, case, paths, loss, loose=False)
    columns, priors, _ = information_of(rival, best)
    return rival, best, columns, priors


def can_join(spec: ArmSpec, path: str) -> bool:
    """Return whether parameters describe an effect: an error of a record, friction, or backlash."""
    match = OF_JOINT.match(path)
    if match is None:
        return of_records(path)
    joint = spec.joints[int(match[1])]
    if match[2] == "backlash":
        return joint.elastic
    return bool(joint.friction and joint.friction.coulomb) == path.endswith("static")


def joined(case: Case, effects: Sequence[Effect], rates: FloatArray) -> tuple[Case, list[str]]:
    """Return a case with effects at their sizes, and the paths of the numbers that describe them.

    ``rates`` (joints,) are those below which friction is smooth, rad/s.
    """
    spec, errors, paths = case.spec, dict(case.errors), list[str]()
    for path, size in [(effect.path, effect.size) for effect in effects]:
        match = OF_JOINT.match(path)
        paths.append(path)
        if match is None:
            errors[path] = errors.get(path, without_error(path)) + size
            continue
        index = int(match[1])
        rate = float(rates[driven_joints(spec).index(index)])
        if match[2] == "backlash":
            spec = with_number(spec, path, size)
        elif match[2] == "friction.coulomb":
            spec = with_coulomb(spec, index, size, rate)
        else:
            friction = spec.joints[index].friction
            assert friction is not None
            friction = friction.replace(
                static=friction.coulomb + size,
                stribeck_rate=_STRIBECK / _SMOOTH * rate,
                smoothing_rate=friction.smoothing_rate or rate,
            )
            spec = with_joint(spec, index, spec.joints[index].replace(friction=friction))
            # Friction that is smooth over a wrong rate has another size at rest.
            paths += [f"joints[{index}].friction.{name}_rate" for name in ("stribeck", "smoothing")]
    return case._replace(spec=spec, errors=errors), paths


def without(case: Case, path: str) -> Case:
    """Return a case without an error of the records or the Stribeck friction of a joint."""
    match = OF_JOINT.match(path)
    if match is None:
        return case._replace(errors={key: e for key, e in case.errors.items() if key != path})
    joint = case.spec.joints[int(match[1])]
    assert joint.friction is not None
    joint = joint.replace(friction=joint.friction.replace(static=None))
    return case._replace(spec=with_joint(case.spec, int(match[1]), joint))


def smoothing_rates(runs: Sequence[RecordRun], case: Case) -> FloatArray:
    """Return the rates (joints,) below which friction is smooth, rad/s."""
    largest = np.zeros(runs[0].samples.shape[1])
    for run in runs:
        rates = run.rates(case)
        if not isinstance(rates, str):
            largest = np.maximum(largest, np.abs(rates).max(axis=0))
    return _SMOOTH * largest


def with_coulomb(spec: ArmSpec, index: int, coulomb: float, rate: float) -> ArmSpec:
    """Return an arm whose joint at an index has Coulomb friction (N m), smooth below a rate."""
    joint = spec.joints[index]
    friction = joint.friction or Friction(coulomb=0.0, smoothing_rate=rate)
    return with_joint(spec, index, joint.replace(friction=friction.replace(coulomb=coulomb)))


def _resized(effect: Effect, case: Case) -> Effect:
    """Return an effect with its size in a case that has it, where it is not linear."""
    path, spec = effect.path, case.spec
    if of_records(path):
        size = case.errors.get(path, without_error(path)) - without_error(path)
    else:
        size = number_at("path", spec, path)
        if path.endswith("static"):
            size -= number_at("path", spec, path.replace("static", "coulomb"))
    assert effect.test is not None
    return effect._replace(sentence=_sentence(*effect.test, size), size=size)


def _sentence(candidate: _Candidate, share: float, size: float) -> str:
    unit = f" {candidate.unit}" if candidate.unit else ""
    # While a joint moves, both act alike.
    offset = candidate.path.startswith("offsets.torque")
    alike = ", or friction of each direction," if offset else ""
    name = effect_name(candidate.path)
    if candidate.stated:
        words = f"that the stated {name.removeprefix('a ')} is about {error_of_stated(size)}"
    elif of_input_delay(candidate.path) and size < 0.0:
        early = name.replace("a delay", "an action")
        words = f"{early} before its record, of about {-size:.2g} s, that the model lacks"
    else:
        words = f"{name} of about {size:.2g}{unit}{alike} that the model lacks"
    return (
        f"The residuals show {words} ({100.0 * share:.0f} % of their power). The standard "
        "deviations contain the change of the estimates by it."
    )


def error_of_stated(size: float) -> str:
    """Return the words on a stated delay that is too short by a ``size`` (s)."""
    return f"{abs(size):.2g} s too {'short' if size > 0.0 else 'long'}"


def _test(
    candidate: _Candidate,
    columns: Sequence[Column],
    basis: FloatArray,
    residuals: FloatArray,
    total: float,
) -> tuple[float, FloatArray]:
    """Return the share of squared residuals that a candidate explains, and its direction."""
    change = np.concatenate(candidate.columns)
    apart = change - basis @ (basis.T @ change)
    size = float(np.linalg.norm(apart))
    if size <= np.sqrt(_DISTINCT) * np.linalg.norm(change):
        return 0.0, apart
    direction = apart / size
    explained = float(direction @ residuals)
    if explained < 0.0 and candidate.positive:
        return 0.0, direction
    # A drift of the residuals resembles an effect in total, but not in each part of the record.
    ends = np.cumsum([column.residuals.size for column in columns])[:-1]
    scores = direction * (residuals - explained * direction)
    parts = [np.array_split(part, _BLOCKS) for part in np.split(scores, ends)]
    blocks = np.sum([[part.sum() for part in record] for record in parts], axis=0)
    if explained**2 < _CONSISTENT**2 * _BLOCKS / (_BLOCKS - 1) * float(blocks @ blocks):
        return 0.0, direction
    every = zip(np.split(residuals, ends), np.split(direction, ends), columns, strict=True)
    noise = [Column(r, np.std(r[c.valid]) * d[:, None], c.valid) for r, d, c in every]
    variance = coloured_information(noise)[0, 0]
    if columns[0].noise is not None:
        variance += np.mean((direction @ np.concatenate([column.noise for column in columns])) ** 2)
    if explained**2 < _DEVIATIONS**2 * variance:
        return 0.0, direction
    return explained**2 / total, direction


def information_of(
    problem: FitProblem, fit: Fit
) -> tuple[list[Column], FloatArray, NDArray[np.bool_]]:
    """Return weighted residuals with derivatives, inverse variances of priors, physical slots."""
    # The columns are those of all channels of all records; slots of initial states are not
    # physical.
    columns = []
    derivatives = problem.derivatives(fit.vector)
    for k, (run, outputs, slope) in enumerate(
        zip(problem.runs, fit.outputs, derivatives, strict=True)
    ):
        places = problem.space.acting_on(k)
        whitened = problem.whitened(k, run.measured - outputs)
        slopes = problem.whitened(k, -slope)
        for c in range(len(run.labels)):
            good = run.valid[:, c]
            own = np.zeros((run.times.size, fit.vector.size))
            own[:, places] = slopes[:, c]
            residuals = whitened[:, c]
            columns.append(Column(np.where(good, residuals, 0.0), own * good[:, None], good, k))
    slots = problem.space.slots
    priors = np.array([slot.prior_deviation**-2.0 for slot in slots])
    columns = with_input_noise(problem, fit, columns, priors)
    return columns, priors, np.array([not slot.initial for slot in slots], dtype=bool)


def _candidates(problem: FitProblem, fit: Fit) -> list[_Candidate]:
    """Return the effects to test, with their changes in all records."""
    zeros = [np.zeros(run.measured.shape) for run in problem.runs]
    changes: dict[str, list[FloatArray]] = {}
    units: dict[str, str] = {}
    for k, (run, outputs) in enumerate(zip(problem.runs, fit.outputs, strict=True)):
        case = problem.space.case(k, fit.vector)
        effects = _of_outputs(run, case, outputs)
        if run.record.driven and run.record.input != "none":
            coarse, rates = run.coarse(), run.coarse().rates(case)
            if not isinstance(rates, str):
                effects |= _of_inputs(coarse, case, rates)
                effects |= _of_gears(coarse, case, rates, outputs)
        # A channel without residuals, such as one that is always zero, has no noise to compare.
        tested = run.valid & np.any((run.measured != outputs) & run.valid, axis=0)
        for path, change in effects.items():
            columns_of_effect = changes.setdefault(path, list(zeros))
            columns_of_effect[k] = problem.whitened(k, np.where(tested, change, 0.0))
            driven = run.record.driven and run.record.input in MEASURED
            of_input = MEASURED[run.record.input].unit if driven else ""
            units[path] = _unit(path, of_input, sliding_joints(case.spec))
    records = [run.record for run in problem.runs]
    return [
        _Candidate(
            path,
            units[path],
            [c for columns in every for c in columns.T],
            path.startswith("joints[") or (least_error(path, records) == 0.0 and _is_delay(path)),
            _is_delay(path) and stated_delay(path, records) != 0.0,
        )
        for path, every in changes.items()
        if any(np.any(columns) for columns in every)
    ]


def _is_delay(path: str) -> bool:
    return path.startswith("delays.")


def sliding_joints(spec: ArmSpec) -> set[object]:
    """Return the numbers of the joints that slide."""
    return {k for k, joint in enumerate(spec.joints, 1) if joint.kind == "prismatic"}


def unit_of(label: Label, slides: Container[object]) -> str:
    """Return the SI unit of a number of a record, empty for a ratio; ``slides``: sliding joints."""
    unit, *sliding = units_of(MEASURED[label.channel])
    return (sliding[0] if sliding and label.part in slides else unit).replace("1", "")


def _unit(path: str, of_input: str, slides: Container[object]) -> str:
    """Return the unit of the size of an effect, with the unit of the input; empty without one."""
    kind, _, text = path.partition(".")
    if match := OF_JOINT.match(path):
        unit = SLIDING.get(of_input, of_input) if int(match[1]) + 1 in slides else of_input
        return "rad" if path.endswith("backlash") else unit
    if kind in ("delays", "gains"):
        return "s" if kind == "delays" else ""
    unit = unit_of(check_label("path", text), slides)
    return f"{unit}/s" if kind == "drifts" else unit


def _of_inputs(run: RecordRun, case: Case, rates: FloatArray) -> dict[str, FloatArray]:
    """Return changes of the outputs by friction and errors of the input."""
    joints = run.samples.shape[1]
    middle = 0.5 * (rates + np.vstack([rates[1:], rates[-1:]]))  # of each sample of the input
    signals: dict[str, FloatArray] = {}
    for k, (number, index) in enumerate(zip(run.joint_numbers, run.joint_places, strict=True)):
        axis = np.eye(joints)[k]
        signals[f"joints[{index}].friction.coulomb"] = -np.sign(middle) * axis
        friction = case.spec.joints[index].friction
        if friction and friction.coulomb and friction.static in (None, friction.coulomb):
            rapid = _STRIBECK * np.abs(rates[:, k]).max() or 1.0
            fading = -np.sign(middle) * np.exp(-((middle / rapid) ** 2))
            signals[f"joints[{index}].friction.static"] = fading * axis
        signals[f"offsets.{run.record.input}_{number}"] = -np.ones_like(middle) * axis
        signals[f"gains.{run.record.input}_{number}"] = -run.samples * axis
    signals[f"delays.{run.record.input}"] = -np.gradient(run.samples, axis=0) * run.record.rate
    size = _SIZE * np.abs(run.samples).max()
    sizes = [size / (np.abs(signal).max() or 1.0) for signal in signals.values()]
    added = [s * f for s, f in zip(signals.values(), sizes, strict=True)]
    changed = run.disturbed(case, [*added, *(-signal for signal in added)])
    ends = zip(changed[: len(added)], changed[len(added) :], strict=True)
    return {
        path: (after - before) / (2.0 * factor)
        for path, factor, (after, before) in zip(signals, sizes, ends, strict=True)
        if factor and not (isinstance(after, str) or isinstance(before, str))
    }


def _of_gears(
    run: RecordRun, case: Case, rates: FloatArray, outputs: FloatArray
) -> dict[str, FloatArray]:
    """Return changes of the outputs by backlash of joints that have none; none if they are white.

    The motor needs time to cross the gap, so that the effect is not proportional to it. The gap
    that is simulated is the part of the angle's range that the worst residuals are of theirs.
    """
    residuals = np.where(run.valid, run.measured - outputs, 0.0)
    columns = [(r, y, good) for r, y, good in zip(residuals.T, outputs.T, run.valid.T, strict=True)]
    if not any(whiteness(r, good) <= SIGNIFICANT for r, _, good in columns):
        return {}
    left = max(np.std(r[good]) / (np.ptp(y[good]) or np.inf) for r, y, good in columns)
    sizes = left * np.ptp(np.cumsum(rates, axis=0), axis=0) / run.record.rate
    effects = {}
    for k, (number, index) in enumerate(zip(run.joint_numbers, run.joint_places, strict=True)):
        joint = case.spec.joints[index]
        geared = joint if joint.elastic else _with_gear(joint, run.record.rate)
        size, led = float(sizes[k]), number in run.record.settings.prescribed
        if geared is None or joint.kind != "revolute" or joint.backlash or led or not size:
            continue
        start = case
        if not joint.elastic:  # the twist is a further coordinate
            place = Arm(case.spec).joint_index[k] + 1
            start = case._replace(
                q=np.insert(case.q, place, 0.0), qd=np.insert(case.qd, place, 0.0)
            )
        specs = [with_joint(case.spec, index, geared.replace(backlash=gap)) for gap in (0.0, size)]
        before, after = run.simulate([start._replace(spec=spec) for spec in specs])
        if not (isinstance(before, str) or isinstance(after, str)):
            effects[f"joints[{index}].backlash"] = (after - before) / size
    return effects


def _with_gear(joint: Joint, rate: float) -> Joint | None:
    """Return a rigid joint with a gear as stiff as a record of a rate (Hz) shows; or None."""
    motor = joint.rotor_inertia * joint.gear_ratio**2
    hub = joint.hub_inertia * (1.0 if motor else 1.0 - _MOTOR)
    motor = motor or _MOTOR * joint.hub_inertia
    if not motor or joint.stiffness:
        return None
    moved = motor * hub / (motor + hub) if hub else motor
    rapid = 2.0 * np.pi * _GEAR * rate
    friction = joint.friction or Friction(coulomb=0.0)
    negative = friction.viscous if friction.viscous_negative is None else friction.viscous_negative
    return joint.replace(
        hub_inertia=hub,
        rotor_inertia=motor / joint.gear_ratio**2,
        stiffness=moved * rapid**2,
        damping=2.0 * _DAMPED * moved * rapid,
        friction=friction.replace(
            viscous=friction.viscous + joint.damping, viscous_negative=negative + joint.damping
        ),
    )


def _of_outputs(run: RecordRun, case: Case, outputs: FloatArray) -> dict[str, FloatArray]:
    """Return changes of the outputs by offsets, drifts, gains and delays of themselves."""
    effects = run.reading_errors(case, outputs)
    slow = run.times[:, None] - run.times.mean()
    offsets = {path: change for path, change in effects.items() if path.startswith("offsets.")}
    drifts = {p.replace("offsets", "drifts"): change * slow for p, change in offsets.items()}
    return effects | drifts
