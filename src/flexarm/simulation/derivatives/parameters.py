"""The run that is differentiated, its parameters, the derivatives of its numbers, and their error.

The error control of the steps knows the motion alone. Each impact multiplies the errors of the
derivatives before it, and each start or end of sticking adds the derivative of its time. A run
through contacts, joint stops and friction that holds is therefore differentiated twice. Without
one, the derivatives are as accurate as the motion.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from inspect import signature
from typing import Any, NamedTuple, TypeVar

import numpy as np

from flexarm.arm.actions import Environment
from flexarm.arm.arm import Arm
from flexarm.arm.closed import sized_gaps
from flexarm.arm.observe import contact_values
from flexarm.base.arguments import check_list_of
from flexarm.base.errors import InputError, Problem, nearest, raise_any, shown, suggestion
from flexarm.control.design.arm_scales import size_of_zero
from flexarm.integrate import Integrator
from flexarm.integrate.base import FloatArray
from flexarm.kernels.compilation.cache import has_number_types
from flexarm.kernels.derivatives.sensitivity import STEP
from flexarm.kernels.forces.contact import GAP
from flexarm.kernels.layout import ArmConstants, Array
from flexarm.linear.statics.gaps import refuse_bristles
from flexarm.linear.step_derivatives.parameters import POWERS, constants_at, scaled, scales_of
from flexarm.model import Link
from flexarm.model.paths import number_at, parts_of, with_number
from flexarm.simulation.calls.preparation import Situation, driving_samples
from flexarm.simulation.calls.run import simulate
from flexarm.simulation.derivatives.differences import SMOOTH, differences
from flexarm.simulation.derivatives.dual_run import (
    ArmInputs,
    Inputs,
    arm_inputs,
    inputs_of_run,
    no_change,
)
from flexarm.simulation.derivatives.loop_in_duals import RecordedLoop
from flexarm.simulation.histories.piecewise import PiecewiseCubic, Samples, spline_edges
from flexarm.simulation.run.channels import CHANNELS
from flexarm.simulation.run.impacts import meets_stops, run_to_slips, slides, stopping_at_breaks
from flexarm.simulation.run.progress import Meter
from flexarm.simulation.run.settings import RunSettings, relative_tolerance, replaced
from flexarm.simulation.run.small_motion import run_closely
from flexarm.simulation.run.stepping import Run
from flexarm.simulation.run.work import Checkpoints

#: Change of a number that is zero, relative to its typical size on the arm, its reduction, and the
#: ratio by which the error of a difference must decrease.
_PROBE, _SMALLER, _DECREASED = 1e-3, 0.125, 0.5
#: Relative differences of two numbers that are rounding.
_ROUNDED = 1e-12
#: Largest relative change of the numbers of an arm that shows whether a parameter opens loops, and
#: the part of it by which gaps then differ from rounding.
_OPENED, _SAME_GAP = 1e-5, 1e-6
#: Columns of a table that must keep their ratio.
_STIFFNESSES = "flexural_rigidity", "shear_rigidity"
_INERTIAS = "mass_per_length", "rotary_inertia_per_length"
#: Relative tolerance for rounding of the columns of two tables.
_SAME = 1e-12
#: Paths of numbers that are not those of the arm: of the state at the start, the torque samples,
#: the force on the tip, and records of the environment.
_STATE = re.compile(r"(initial|initial_rate)\[(\d{1,6})\]")
SAMPLE = re.compile(r"torque\[(\d{1,9})\]\[(\d{1,6})\]")
_TIP = re.compile(r"tip_force\[([012])\]")
_RECORD = re.compile(r"(loads|contacts)\[(\d{1,6})\]\.(.+)")
#: Channels that follow from q and qd alone.
_OF_STATES = (
    *("joint_angle", "joint_rate", "joint_twist", "link_angle", "link_rate"),
    *("link_tip_deflection", "link_tip_slope", "link_tip_deflection_rate", "link_tip_slope_rate"),
    *("tip", "tip_velocity", "tip_angle", "tip_angle_rate"),
    *("kinetic_energy", "strain_energy", "gravity_energy", "strain", "q", "qd"),
)


def arm_derivative(name: str, arm: Arm, environment: Environment, path: str) -> ArmInputs:
    """Return the derivatives of ``arm_inputs`` by the number at a path."""
    value = number_at(name, arm.spec, path)
    if not _has_formula(arm, environment, path, value):
        if value == 0.0:
            hint = "It is 0 in this arm. Give it another value."
            raise InputError(Problem(name, SMOOTH, shown(path), hint))
        at = partial(_moved, name, arm, environment, path)
        return ArmInputs(*differences(name, path, value, abs(value), at))
    found = _by_formula(arm, environment, path, value)
    if value == 0.0:
        _check_zero(name, arm, environment, path, found)
    return found


def _has_formula(arm: Arm, environment: Environment, path: str, value: float) -> bool:
    """Return whether the constants depend on a number by the formulas of ``constants_at``."""
    parts = parts_of(path)
    if parts[0] != "links":
        return True
    link, field = int(parts[1]), parts[2]
    if field == "damping":
        return True
    if field == "hub_radius":
        return not _has_points(environment, link)
    if field == "gauges":
        return parts[-1] == "distance"
    try:
        changed = with_number(arm.spec, path, 2.0 * value, checked=False).links[link]
        return value != 0.0 and _keeps_shapes(arm, environment, link, changed)
    except (TypeError, ValueError):  # a section whose formulas do not accept this number
        return False


def _keeps_shapes(arm: Arm, environment: Environment, link: int, changed: Link) -> bool:
    """Return whether the mode shapes of a link keep their form if it is replaced by another one.

    They do if rigidity, mass and length are each multiplied by a factor; theory page "separation",
    (D.15). A length must not move points at given stations, either.
    """
    tables = arm.spec.links[link].beam(), changed.beam()
    factors = {}
    for column in ("x", *_STIFFNESSES, *_INERTIAS):
        before, after = (np.array(getattr(table, column) or (), dtype=float) for table in tables)
        there = before != 0.0
        ratio = after[there] / before[there]
        if np.any(after[~there]) or (ratio.size and np.ptp(ratio) > _SAME * ratio[0]):
            return False
        if ratio.size:
            factors[column] = float(ratio[0])
    for pair in (_STIFFNESSES, _INERTIAS):
        own = [factors[column] for column in pair if column in factors]
        if own and max(own) - min(own) > _SAME * own[0]:
            return False
    if factors["x"] == 1.0:
        return True
    shaped = "shear_rigidity" in factors or "rotary_inertia_per_length" in factors
    return not (shaped or _has_points(environment, link) or arm.spec.links[link].gauges)


def _has_points(environment: Environment, link: int) -> bool:
    """Return whether loads or contacts act on a link, counted from 0."""
    points = *environment.loads, *environment.contacts
    return any(getattr(point, "link", None) in (None, link + 1) for point in points)


def _by_formula(arm: Arm, environment: Environment, path: str, value: float) -> ArmInputs:
    given = value + 1j * STEP
    constants, gauges = constants_at(arm, {path: given}, complex)
    spec = with_number(arm.spec, path, given, checked=False)
    masses = [
        scales_of(old, new).get("mass", 1.0)
        for old, new in zip(arm.spec.links, spec.links, strict=True)
    ]
    loads = Environment(environment.loads, None, environment.contacts).placed(arm)

    def shapes(array: Array, body: Array, power: float) -> Array:
        """Scale shapes (k, ...) at points of links, which are mass-normalised, with the mass."""
        moved = array.astype(complex)
        for row, owner in zip(moved, body, strict=True):
            row[...] = scaled(row, masses[arm.assembly.piece_of(owner).link], power)
        return moved

    shape, square = POWERS["mass"]["P"], POWERS["mass"]["G"]
    points = loads.contacts
    moved = [*constants, gauges, loads.weight, loads.lever]
    moved += [shapes(rows, loads.body, shape) for rows in (loads.rows, loads.slopes)]
    moved.append(shapes(loads.shortening, loads.body, square))
    moved.append(shapes(points.rows, points.body, shape))
    moved += [shapes(points.shortening, points.body, square), points.law]
    return ArmInputs(*(np.imag(array) / STEP for array in moved))


def _moved(name: str, arm: Arm, environment: Environment, path: str, value: float) -> ArmInputs:
    """Return the numbers of the arm with another value of a parameter."""
    try:
        changed = Arm(with_number(arm.spec, path, value))
        found = arm_inputs(changed, environment)
    except InputError as error:
        hint = str(error.problems[0])
        rule = "be a number that can change by a few per cent"
        raise InputError(Problem(name, rule, shown(path), hint)) from None
    return found


def _check_zero(name: str, arm: Arm, environment: Environment, path: str, found: ArmInputs) -> None:
    """Raise if the equations omit the terms of a number that is zero."""
    before = arm_inputs(arm, environment)
    size = _PROBE * size_of_zero(arm, arm.spec, path)
    for change in (size, -size):
        try:
            moved = [_moved(name, arm, environment, path, c) for c in (change, _SMALLER * change)]
        except InputError:  # the model limits this number on one side
            continue
        if all(map(_is_slope, before, *moved, found, [change] * len(before))):
            return
    hint = "It is 0 in this arm, so that the equations omit its terms. Give it another value."
    raise InputError(Problem(name, SMOOTH, shown(path), hint))


def _is_slope(old: Array, far: Array, near: Array, slope: Array, change: float) -> bool:
    """Return whether differences over a change, and over a smaller one, converge to a slope."""
    if not old.shape == far.shape == near.shape:
        return False
    errors = np.abs(near - old - _SMALLER * change * slope)
    # Terms of second order decrease with the square of the change.
    usual = _SMALLER * _DECREASED * np.abs(far - old - change * slope)
    return bool(np.all(errors <= usual + _ROUNDED * np.maximum(np.abs(old), np.abs(near))))


def is_of_arm(path: str) -> bool:
    """Return whether a path is that of a number of the arm."""
    return not any(kind.fullmatch(path) for kind in (_STATE, SAMPLE, _TIP, _RECORD))


@dataclass(frozen=True, eq=False)
class Parameters:
    """Parameters of a run that has been simulated."""

    run: Run
    environment: Environment  # loads and contacts of the run
    inputs: Inputs
    samples: Samples | None  # the torque samples; None if the torque does not consist of samples
    tip_forces: int  # number of loads at the beginning that are the force on the tip
    loop: RecordedLoop | None = None  # the closed loop; None without a controller
    #: from which parts of the run can be repeated; None if not requested
    checkpoints: Checkpoints | None = None

    def derivatives(self, paths: Sequence[str]) -> list[Inputs]:
        """Return the derivatives of the numbers of the run by each parameter."""
        found: list[Inputs] = []
        problems: list[Problem] = []
        for k, path in enumerate(paths):
            name = f"parameters[{k}]"
            try:
                if path in paths[:k]:
                    raise InputError(Problem(name, f"repeats {path}"))
                found.append(self._derivative(name, path))
                self._refuse_opening(name, path, found[-1])
            except InputError as error:
                problems += error.problems
        raise_any(problems)
        return found

    def _derivative(self, name: str, path: str) -> Inputs:
        nothing = no_change(self.inputs)
        if (place := _STATE.fullmatch(path)) is not None:
            return nothing._replace(state=self._unit_state(name, path, int(place[2]), place[1]))
        if (place := SAMPLE.fullmatch(path)) is not None:
            return nothing._replace(torque=self._sample(name, path, int(place[1]), int(place[2])))
        if (place := _TIP.fullmatch(path)) is not None:
            if not self.tip_forces:
                raise InputError(Problem(name, "requires tip_force", hint="Zeros are possible."))
            value = np.zeros_like(self.inputs.load_value)
            value[0, int(place[1])] = 1.0
            return nothing._replace(load_value=value)
        if (place := _RECORD.fullmatch(path)) is not None:
            return self._of_record(name, path, place[1], int(place[2]), place[3])
        return nothing._replace(arm=arm_derivative(name, self.run.arm, self.environment, path))

    def _refuse_opening(self, name: str, path: str, change: Inputs) -> None:
        """Raise if a change of numbers opens loops that the state at the start closes."""
        arm = self.run.arm
        if not arm.closure_rows:
            return
        values = *self.inputs.arm.constants, self.inputs.state
        slopes = *change.arm.constants, change.state
        steepest = max(map(relative_error, map(np.add, values, slopes), values))
        if not steepest:
            return
        ends = []
        for step in (_OPENED / steepest, -_OPENED / steepest):
            *constants, state = map(np.add, values, (step * slope for slope in slopes))
            ends.append(sized_gaps(arm, ArmConstants(*constants), state))
        if np.max(np.abs(ends[0] - ends[1])) > _SAME_GAP * _OPENED:
            hint = "The state at the start closes them for one value only."
            raise InputError(Problem(name, "keep the loops closed", shown(path), hint))

    def _unit_state(self, name: str, path: str, place: int, which: str) -> Array:
        """Return the derivative of the state at the start by one of its entries."""
        arm, run = self.run.arm, self.run
        if place >= arm.dof:
            rule = f"have an index below {arm.dof}, the number of coordinates"
            raise InputError(Problem(name, rule, shown(path)))
        numbers = zip(arm.joint_index, arm.joint_numbers, strict=True)
        if place in [index for index, number in numbers if number in run.prescribed]:
            raise InputError(Problem(name, f"is not supported with prescribed motion: {path}"))
        unit = np.zeros((2, arm.dof))
        unit[int(which == "initial_rate"), place] = 1.0
        return arm.padded(unit)

    def _sample(self, name: str, path: str, sample: int, joint: int) -> Array:
        """Return the derivative of the torque by one of its samples."""
        arm, samples = self.run.arm, self.samples
        if samples is None or self.run.prescribed:
            rule = (
                "requires torque as an array of samples, without controller and prescribed motion"
            )
            raise InputError(Problem(name, rule))
        if sample >= samples.shape[0] or joint >= samples.shape[1]:
            rule = f"be a sample of torque, which has shape {samples.shape}"
            raise InputError(Problem(name, rule, shown(path)))
        unit = np.zeros(samples.shape)
        unit[sample, joint] = 1.0
        return arm.padded_torque(samples.added(unit))

    def _of_record(self, name: str, path: str, which: str, place: int, inside: str) -> Inputs:
        """Return the derivatives by a number of a load or a contact."""
        first = self.tip_forces if which == "loads" else 0
        records = list(getattr(self.environment, which))
        if first + place >= len(records):
            rule = f"have an index below {len(records) - first}, the number of {which}"
            raise InputError(Problem(name, rule, shown(path)))
        record = records[first + place]
        value = number_at(name, record, inside)

        def at(changed: float) -> list[Array]:
            records[first + place] = with_number(record, inside, changed)
            environment = replace(self.environment, **{which: records})
            value = Environment(environment.loads).placed(self.run.arm).value
            return [*arm_inputs(self.run.arm, environment), value]

        scale = abs(value) or size_of_zero(self.run.arm, record, inside)
        *arm, load_value = differences(name, path, value, scale, at)
        own = no_change(self.inputs)
        return own._replace(arm=ArmInputs(*arm), load_value=load_value)


def simulated(
    situation: Situation,
    by_samples: bool,
    meter: Meter,
    checkpoints: Checkpoints | None = None,
    *,
    once: bool = False,
) -> Parameters:
    """Simulate a run; return what its derivatives require.

    Args:
        by_samples: whether steps end at every torque sample. A step that spans several samples
            computes their derivatives inaccurately.
        checkpoints: filled by a run without a controller.
        once: whether the run has exactly these tolerances, and is not repeated with others.
    """
    if not has_number_types():
        raise InputError(Problem("NUMBA_DISABLE_JIT", "is not supported with derivatives of runs"))
    arm, environment = situation.arm, situation.environment
    if len(situation.events):
        refuse_bristles(arm, "events", hint="Their times have no derivatives then.")
    run = situation.new_run(meter)
    tips = int(situation.tip_force is not None)
    if situation.controller is not None:
        law = situation.controller, situation.reference, situation.hardware
        loop = RecordedLoop(run, *law, channels_of_states(arm))
        loop.execute()
        run.history = loop.history
        return Parameters(run, environment, inputs_of_run(run, environment), None, tips, loop)
    history_of = situation.history_of(run)
    torque_of = partial(stopping_at_breaks, history_of) if by_samples else history_of
    (run_to_slips if once else run_closely)(run, torque_of, checkpoints)
    inputs, samples = inputs_of_run(run, environment), _samples(situation, history_of)
    return Parameters(run, environment, inputs, samples, tips, checkpoints=checkpoints)


def _samples(situation: Situation, history_of: Callable[[float], PiecewiseCubic]) -> Samples | None:
    """Return torque samples; None for another kind of torque."""
    torque, settings = situation.torque, situation.settings
    if torque is None or callable(torque) or isinstance(torque, PiecewiseCubic):
        return None
    samples, joints = np.shape(torque)
    history = history_of(relative_tolerance(settings, situation.simulated))
    driving = driving_samples(situation.simulated, torque, situation.prescribed or ())
    edges = spline_edges(driving, situation.rate, settings.breaks)
    return Samples(history, (samples, joints), situation.rate, settings.torque_interpolation, edges)


def refuse_unsupported(function: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Raise if there are arguments that derivatives do not support, or unknown ones."""
    known = signature(simulate).parameters
    problems = [
        Problem(name, "is not supported with derivatives of runs")
        if name in known
        else Problem(name, "is not an argument", hint=nearest(name, known))
        for name in arguments
        if name not in vars(function)["keywords"]
    ]
    raise_any(problems)


def channels_of_states(arm: Arm) -> list[str]:
    """Return the names of the channels of an arm that follow from q and qd."""
    return [name for name in _OF_STATES if name != "strain" or arm.gauges]


def check_channels(arm: Arm, argument: str, given: Sequence[str] | None) -> list[str]:
    """Return the names of channels; None: of all that are possible."""
    possible = channels_of_states(arm)
    if given is None:
        return possible
    names = check_list_of(argument, given, str)
    known = f"Known: {', '.join(possible)}."
    problems = [
        Problem(
            f"{argument}[{k}]",
            "be a channel that follows from q and qd",
            repr(name),
            # No similar name if the channel exists: it is not a spelling error.
            known if name in CHANNELS else suggestion(name, possible),
        )
        for k, name in enumerate(names)
        if name not in possible
    ]
    raise_any(problems)
    return names


#: Ratio of both tolerances, also for joints that slide against friction that holds, and the least
#: relative tolerance that rounding errors allow. Each time at which a joint sticks or slips has the
#: error of a step: derivatives of two sliding joints have 6e-6 at a ratio of 0.01, and 1e-7 here.
_RATIO, _SLIDING, _LEAST = 0.01, 1e-4, 1e-13
#: Difference of both runs above which derivatives get a warning: at a hundredth of the tolerances,
#: and with half the step, where the error of the result is about the difference.
_DOUBTFUL, _DOUBTFUL_STEP = 1e-2, 1e-3


class SecondRun(NamedTuple):
    """Settings of a second run."""

    settings: RunSettings
    tighter: bool  # whether it is the more accurate one
    allowed: float  # largest difference without a warning


T = TypeVar("T", bound=Any)  # derivatives, with the attribute ``run``


def differentiated(
    situation: Situation,
    twice: bool,
    once: Callable[[Situation, bool], T],
    apart: Callable[[T, T], FloatArray],
) -> tuple[T, FloatArray | None, str]:
    """Return derivatives, estimates of their relative errors, None without, and a warning.

    Args:
        twice: whether a run with contacts, stops or sliding is differentiated twice.
        once: differentiates a run, perhaps with exactly the tolerances of its settings.
        apart: relative differences of the derivatives of two runs.
    """
    derivatives = once(situation, False)
    run, settings = derivatives.run, situation.settings
    second = second_run(run, settings) if twice else None
    if second is None:
        return derivatives, None, run.doubt
    other = once(replace(situation, settings=second.settings), True)
    errors, doubt = apart(derivatives, other), run.doubt
    if not (doubt or errors.max() <= second.allowed):
        doubt = (
            f"the derivatives have an estimated relative error of {errors.max():.1g}, because "
            "contacts, joint stops or friction amplify errors. Reduce rtol and atol, step or the "
            "duration."
        )
    return other if second.tighter else derivatives, errors, doubt


def second_run(run: Run, settings: RunSettings) -> SecondRun | None:
    """Return the settings of a second run; None if ``run`` met no contact, no stop and no friction.

    The second run is not repeated with other tolerances, so that these are the ones in use.
    """
    integrator, progress, used = run.integrator, run.progress, run.tolerance
    met = progress.impacts + progress.touches > 0 if integrator.adaptive else _touches(run)
    if not (met or slides(run)):
        return None
    if not integrator.adaptive:
        search, method = run.default_step, settings.integrator
        half = 0.5 * float((integrator.step if search is None else search.shortest) or 0.0)
        if isinstance(method, Integrator):
            halved = replaced(settings, integrator=replace(method, step=half))
        else:
            halved = replaced(settings, step=half)
        return SecondRun(halved, True, _DOUBTFUL_STEP)
    tighter = used.relative * _RATIO >= _LEAST
    ratio = _RATIO if tighter else 1.0 / _RATIO
    if slides(run) and used.relative * _SLIDING >= _LEAST:
        ratio = _SLIDING
    second = replaced(settings, rtol=ratio * used.relative, atol=ratio * used.absolute * used.scale)
    return SecondRun(second, tighter, _DOUBTFUL)


def _touches(run: Run) -> bool:
    """Return whether a contact or a stop is compressed at a sample of a run with fixed steps."""
    placed, states = run.loads.placed.contacts, run.samples[: run.progress.sample]
    if placed.body.size and np.any(contact_values(run.arm, placed, states)[..., GAP] < 0.0):
        return True
    return meets_stops(run)


def state_errors(run: Run, slopes: FloatArray, times: FloatArray, others: FloatArray) -> FloatArray:
    """Return the largest differences (p,) of both derivatives of the states, relative to them."""
    count = min(len(times), len(run.sample_times))
    same = np.flatnonzero(times[:count] == run.sample_times[:count])
    scaled, reference = (array[:, same] / run.tolerance.unit for array in (slopes, others))
    errors = [
        max(relative_error(a[:, level], b[:, level]) for level in range(2))
        for a, b in zip(scaled, reference, strict=True)
    ]
    return np.array(errors)


def relative_error(array: FloatArray, reference: FloatArray) -> float:
    """Return the largest difference of two arrays, relative to the largest number."""
    size = float(np.abs(reference).max(initial=0.0))
    difference = float(np.abs(array - reference).max(initial=0.0))
    return difference / size if size > 0.0 else difference
