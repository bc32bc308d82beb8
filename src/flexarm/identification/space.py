"""Free parameters as a vector: shared, per record, and the initial states of records."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.coordinates import coordinate_sizes
from flexarm.arm.closed import assembled, independent_motions
from flexarm.base.errors import InputError, Problem, nearest, problems_of, raise_any, shown
from flexarm.control.design.arm_scales import size_of_zero, typical_rate
from flexarm.identification.record import Label, MeasuredRecord, columns_of, label_of, place_of
from flexarm.integrate.base import FloatArray
from flexarm.model import ArmSpec, Joint, Motors
from flexarm.model.identification import FreeParameter
from flexarm.model.paths import number_at, parts_of, with_number

#: Modes of each link whose initial values are estimated.
_MODES = 2
#: Typical tip deflection of a link at the start, as a fraction of its length, typical joint angle
#: (rad), and joint rate relative to the rate of the arm: the scale of the steps, and for modes the
#: deviation of the prior.
_BENT, _ANGLE, _RATE = 0.1, 0.1, 0.05
#: Large offset as a fraction of its signal, and large error of a gain.
_ERROR = 0.1
_MOTORS = "motors."
_INITIAL = re.compile(r"initial\.(qd?)\[(\d+)\]$")
#: Errors of a record: what it contains is ``gain * truth(t - delay) + offset``.
_OF_RECORDS = re.compile(r"(offsets|gains|delays)\.(\w+)$")


class Case(NamedTuple):
    """What a vector of parameters means for a record."""

    spec: ArmSpec  # the arm
    motors: Motors | None  # of records with a current as input, or None
    q: FloatArray  # (dof,) added to the initial state
    qd: FloatArray  # (dof,) added to the initial state
    errors: Mapping[str, float] = MappingProxyType({})  # of the record, by path: offsets.strain_1


@dataclass(frozen=True)
class Slot:
    """One number of the vector; start, bounds and prior are in its unit."""

    path: str  # of a number of the arm, ``motors.torque_constant``, or ``initial.q[0]``
    record: int | None  # index of the record whose value it is; None: shared by all
    name: str  # unique in results
    start: float
    lower: float
    upper: float
    scale: float  # magnitude of a large change, positive
    prior: float  # expected value
    prior_deviation: float  # infinite without a prior

    @property
    def initial(self) -> bool:
        """Whether it belongs to the initial state of a record."""
        return _INITIAL.match(self.path) is not None


class Space:
    """Vectors of the free parameters, from the values of the arm and motors, and their meaning."""

    def __init__(
        self,
        arm: Arm,
        motors: Motors | None,
        free: Sequence[FreeParameter],
        records: dict[str, MeasuredRecord],
        errors: Mapping[str, float] = MappingProxyType({}),
    ) -> None:
        self._arm, self._motors, self._errors = arm, motors, dict(errors)
        self._names, self._records, self._free = list(records), records, list(free)
        interval = 1.0 / max(record.rate for record in records.values())
        self._rate = typical_rate(arm, interval)
        problems: list[Problem] = []
        slots: list[Slot] = []
        seen: set[str] = set()
        for k, parameter in enumerate(free):
            name = f"free[{k}]"
            if parameter.path in seen:
                problems.append(Problem(name, f"repeats {parameter.path}"))
                continue
            seen.add(parameter.path)
            refusals = problems_of(self._number, name, parameter.path)
            problems += refusals or self._start_problems(name, parameter)
            if not problems:
                slots += self._slots_of(parameter)
        raise_any(problems)
        for k, record in enumerate(records.values()):
            rate = _RATE * self._rate
            slots += _initial_slots(arm, k, self._names[k], record, rate)
        self.slots = slots

    def _owner(self, name: str, path: str) -> tuple[ArmSpec | Motors, str]:
        """Return the arm or the motors to which a path belongs, and the path in it."""
        if not path.startswith(_MOTORS):
            return self._arm.spec, path
        if self._motors is None:
            raise InputError(Problem(name, f"is {path}, which requires motors"))
        return self._motors, path.removeprefix(_MOTORS)

    def _number(self, name: str, path: str) -> float:
        if not of_records(path):
            return number_at(name, *self._owner(name, path))
        paths = {p for record in self._records.values() for p in error_paths(record)}
        if path not in paths:
            rule = "be an error of a channel in the records"
            raise InputError(Problem(name, rule, shown(path), nearest(path, sorted(paths))))
        return self._errors.get(path, without_error(path))

    def _start_problems(self, name: str, parameter: FreeParameter) -> list[Problem]:
        start = self._number(name, parameter.path)
        low = -np.inf if parameter.lower is None else parameter.lower
        high = np.inf if parameter.upper is None else parameter.upper
        if low <= start <= high:
            return []
        rule = f"has bounds {low:g} to {high:g} that exclude {start:g}, the value of the arm"
        return [Problem(f"{name}: {parameter.path}", rule)]

    def _slots_of(self, parameter: FreeParameter) -> list[Slot]:
        path = parameter.path
        start = self._number("free", path)
        lower = parameter.lower
        if lower is None and of_records(path):
            lower = least_error(path, self._records.values())
        if lower is None:
            below = -1e-6 * (abs(start) or 1.0)
            refused = problems_of(with_number, *self._owner("free", path), below)
            lower = 0.0 if refused and start >= 0.0 else -np.inf
        upper = np.inf if parameter.upper is None else parameter.upper
        deviation = parameter.prior_deviation
        prior = start if parameter.prior is None else parameter.prior
        size = abs(start) or deviation or (upper - lower if np.isfinite(upper - lower) else 0.0)
        if of_records(path):
            scale = max(error_scale(path, record) for record in self._records.values())
        else:
            scale = size or size_of_zero(self._arm, *self._owner("free", path), self._rate)
        last = prior, np.inf if deviation is None else deviation
        if not parameter.per_record:
            return [Slot(path, None, path, start, lower, upper, scale, *last)]
        return [
            Slot(path, k, f"{path} ({name})", start, lower, upper, scale, *last)
            for k, name in enumerate(self._names)
        ]

    def wider(self, case: Case, paths: Sequence[str], loose: bool) -> Space:
        """Return the space from a case with further free numbers.

        ``loose``: without bounds and priors.
        """
        unbounded = dict.fromkeys(("lower", "upper", "prior", "prior_deviation"))
        free = {path: FreeParameter(path) for path in paths}
        for p in self._free:
            expected = {slot.path: slot.prior for slot in self.slots}[p.path]
            kept = {"prior": expected} if p.prior_deviation else {}
            free[p.path] = p.replace(**(unbounded if loose else kept))
        return Space(Arm(case.spec), case.motors, list(free.values()), self._records, case.errors)

    @property
    def start(self) -> FloatArray:
        """The vector (parameters,) from which the estimation starts."""
        return np.array([slot.start for slot in self.slots])

    @property
    def scale(self) -> FloatArray:
        """Scale (parameters,) of each number."""
        return np.array([slot.scale for slot in self.slots])

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds (parameters,)."""
        slots = self.slots
        return np.array([s.lower for s in slots]), np.array([s.upper for s in slots])

    def acting_on(self, record: int) -> NDArray[np.intp]:
        """Return the places in the vector that have an effect on a record."""
        places = [k for k, slot in enumerate(self.slots) if slot.record in (None, record)]
        return np.array(places, dtype=np.intp)

    def case(self, record: int | None, vector: FloatArray) -> Case:
        """Return the meaning of a vector for a record; None: without values of single records."""
        spec, motors, errors = self._arm.spec, self._motors, dict(self._errors)
        state = {"q": np.zeros(self._arm.dof), "qd": np.zeros(self._arm.dof)}
        for slot, value in zip(self.slots, vector.tolist(), strict=True):
            if slot.record is not None and slot.record != record:
                continue
            match = _INITIAL.match(slot.path)
            if match:
                state[match[1]][int(match[2])] = value
            elif of_records(slot.path):
                errors[slot.path] = value
            elif slot.path.startswith(_MOTORS):
                assert motors is not None
                motors = with_number(motors, slot.path.removeprefix(_MOTORS), value)
            else:
                spec = with_number(spec, slot.path, value)
        return Case(spec, motors, state["q"], state["qd"], errors)


def random_start(space: Space, random: np.random.Generator) -> FloatArray:
    """Draw a start: between finite bounds, else by a factor of e^0.4 about a positive value."""
    vector = space.start
    lower, upper = space.bounds
    for k, slot in enumerate(space.slots):
        if slot.initial:
            continue
        if np.isfinite(lower[k]) and np.isfinite(upper[k]):
            if lower[k] > 0.0:
                vector[k] = np.exp(random.uniform(np.log(lower[k]), np.log(upper[k])))
            else:
                vector[k] = random.uniform(lower[k], upper[k])
        elif vector[k] > 0.0:
            vector[k] *= np.exp(0.4 * random.standard_normal())
        else:
            vector[k] += 0.4 * slot.scale * random.standard_normal()
        vector[k] = min(max(vector[k], lower[k]), upper[k])
    return vector


def with_joint(spec: ArmSpec, index: int, joint: Joint) -> ArmSpec:
    """Return an arm with another joint at an index."""
    joints = list(spec.joints)
    joints[index] = joint
    return spec.replace(joints=joints)


def of_records(path: str) -> bool:
    """Return whether a path is an error of a record, such as ``delays.strain_1``."""
    return _OF_RECORDS.match(path) is not None


def of_input_delay(path: str) -> bool:
    """Return whether a path is the delay of the inputs, which is negative if they act early."""
    return path.startswith("delays.") and "_" not in path


def stated_delay(path: str, records: Iterable[MeasuredRecord]) -> float:
    """Return the smallest delay (s) that records state for the channel of a path."""
    text = path.partition(".")[2]
    label = label_of(text)
    channel = label.channel if label else text
    return min((record.settings.delays.get(channel, 0.0) for record in records), default=0.0)


def least_error(path: str, records: Iterable[MeasuredRecord]) -> float:
    """Return the lowest size of an error of records: no reading is before its quantity."""
    if path.startswith("offsets.") or of_input_delay(path):
        return -np.inf
    return -stated_delay(path, records) if path.startswith("delays.") else 0.0


def error_paths(record: MeasuredRecord) -> list[str]:
    """Return the paths of the errors that a record may have."""
    outputs, inputs = ([label.text for label in x] for x in (record.outputs, record.inputs))
    both = [f"{kind}.{text}" for text in [*outputs, *inputs] for kind in ("offsets", "gains")]
    return both + [f"delays.{text}" for text in [*outputs, *([record.input] if inputs else [])]]


def without_error(path: str) -> float:
    return 1.0 if path.startswith("gains.") else 0.0


def error_scale(path: str, record: MeasuredRecord) -> float:
    """Return the magnitude of a large error: a sample of delay, a tenth of the signal."""
    kind, _, text = path.partition(".")
    if kind == "delays":
        return 1.0 / record.rate
    columns = {label.text: c for label, c in (record.outputs | record.inputs).items()}
    size = float(np.nanstd(columns[text])) if text in columns else 0.0
    return _ERROR if kind == "gains" else _ERROR * size or 1e-300


def initial_argument(path: str) -> str:
    """Return the path of a number of an initial state as ``sensitivities`` has it; else empty."""
    match = _INITIAL.match(path)
    if match is None:
        return ""
    return f"{'initial' if match[1] == 'q' else 'initial_rate'}[{match[2]}]"


def _initial_slots(
    arm: Arm, index: int, name: str, record: MeasuredRecord, rate: float
) -> list[Slot]:
    """Return the estimated numbers of the initial state of a record, as changes of its start.

    ``rate`` is the scale of joint rates, rad/s; of sliding joints relative to the reach.
    """
    settings = record.settings
    if record.controller is not None:
        return []
    slots: list[Slot] = []
    sizes = coordinate_sizes(arm).tolist()

    def add(kind: str, place: int, scale: float, deviation: float = np.inf) -> None:
        path = f"initial.{kind}[{place}]"
        values = 0.0, -np.inf, np.inf, scale, 0.0, deviation
        slots.append(Slot(path, index, f"{path} ({name})", *values))

    in_motion, led = settings.initial == "estimate", leading_joints(arm, record)
    measured = columns_of(record.data, ["joint_angle"]) if "joint_angle" in record.data else {}
    for joint, place in zip(arm.joint_numbers.tolist(), arm.joint_index.tolist(), strict=True):
        if joint in settings.prescribed or joint not in led:
            continue
        if in_motion or (
            settings.initial_angle is None and Label("joint_angle", joint) in measured
        ):
            add("q", place, _ANGLE * sizes[place])
        if in_motion:
            add("qd", place, rate * sizes[place])
    if in_motion:
        for place, amplitude, frequency in _modes(arm):
            add("q", place, amplitude, amplitude)
            add("qd", place, amplitude * frequency, amplitude * frequency)
    return slots


def start_angles(arm: Arm, record: MeasuredRecord) -> FloatArray:
    """Return the joint angles (joints,) at the start, before estimated changes."""
    if record.settings.initial_angle is not None:
        return np.array(record.settings.initial_angle)
    angles = np.zeros(arm.n_joints)
    if "joint_angle" in record.data:
        for label, column in columns_of(record.data, ["joint_angle"]).items():
            angles[place_of(arm, label)] = column[np.isfinite(column)][0]
    return angles


def leading_joints(arm: Arm, record: MeasuredRecord) -> list[int]:
    """Return the numbers of the joints that the others follow in a closed mechanism; or all."""
    if not arm.closure_rows:
        return [int(number) for number in arm.joint_numbers]
    q = assembled(arm, arm.rest(start_angles(arm, record))).q
    free = independent_motions(arm, q, np.arange(arm.dof)).independent
    return [int(number) for number in arm.joint_numbers[np.isin(arm.joint_index, free)]]


def _modes(arm: Arm) -> list[tuple[int, float, float]]:
    """Return place in q, frequency (rad/s) and amplitude of equal energy of the lowest modes."""
    lowest = []
    for piece in arm.assembly.pieces:
        shapes = piece.shapes
        if not shapes.w2.size:
            continue
        frequencies = np.sqrt(shapes.w2[:_MODES])
        first = _BENT * shapes.length / abs(shapes.P[0])
        for k, frequency in enumerate(frequencies.tolist()):
            amplitude = float(first * frequencies[0] / frequency)
            lowest.append((piece.first + k, amplitude, frequency))
    return lowest


def in_words(path: str) -> str:
    """Return a path as words: ``links[0].flexural_rigidity`` is "flexural rigidity of link 1"."""
    if of_records(path):
        kind, _, text = path.partition(".")
        return f"{kind.removesuffix('s')} of {text if '_' in text else f'the {text}'}"
    words: list[str] = []
    parts = parts_of(path)
    for part, inside in zip(parts, [*parts[1:], None], strict=True):
        if isinstance(part, int):
            continue
        word = part.replace("_", " ")
        if isinstance(inside, int):
            word = f"{word.removesuffix('s')} {inside + 1}"
        elif inside is not None:
            word = f"the {word}"
        if words and words[-1] == "the friction":
            words[-1] = word if word.startswith("bristle") else f"{word} friction"
        else:
            words.append(word)
    if words and words[0] == "the motors":
        *_, last = parts
        words = (
            [words[-1].removesuffix(f" {last + 1}"), f"motor {last + 1}"]
            if isinstance(last, int)
            else [words[-1], "the motors"]
        )
        return " of ".join(words)
    return " of ".join(reversed(words))


def check_free(value: object, least: int = 1) -> list[FreeParameter]:
    """Return free parameters, from a list of paths and ``FreeParameter`` objects."""
    listed = isinstance(value, list | tuple)
    items = list(value) if isinstance(value, list | tuple) else []
    if (
        not listed
        or len(items) < least
        or not all(isinstance(item, str | FreeParameter) for item in items)
    ):
        rule = "be a list of paths and FreeParameter objects"
        raise InputError(Problem("free", rule, shown(value)))
    return [FreeParameter(item) if isinstance(item, str) else item for item in items]
