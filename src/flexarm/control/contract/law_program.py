"""Programs of laws: lists of operations, which run without Python.

There is no second law: the ``step`` of a controller is executed once with arrays that record what
NumPy would do with their entries, and which terms of a model it evaluates. A law with other
operations, with decisions on numbers, or with several models, is not recorded. The recorded
operations are those of the step in the same order, so that torques and memory are equal to the last
bit, but for the signs of zeros. Each law is tested before its use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from flexarm.arm.assembly.kernel_view import KernelView
from flexarm.control.contract.base import Arrays, Controller, around, is_law
from flexarm.control.hardware.measurement import FloatArray, Measurement
from flexarm.kernels.controller_terms.law_program import (
    OPERATIONS,
    TERMS,
    LawModel,
    LawProgram,
    law_step,
)
from flexarm.kernels.controller_terms.rigid_terms import SET_COLUMNS
from flexarm.kernels.layout import empty_constants

#: Most operations of a recorded law.
_MOST = 20_000
#: Random samples at which a recorded law is compared with its step.
_TRIALS = 3
#: Signals of the arm in a program, in the order of their places.
SENSED = ("joint_angle", "joint_rate", "strain")
#: Functions of NumPy that only move entries.
_MOVES = {
    *(np.concatenate, np.stack, np.broadcast_to, np.reshape, np.ravel, np.atleast_1d, np.tile),
    *(np.swapaxes, np.moveaxis, np.transpose, np.split),
}
#: Other names of operations, those of truth values included.
_ALIASES = {
    "true_divide": "divide",
    "fabs": "absolute",
    "logical_and": "minimum",
    "logical_or": "maximum",
    "bitwise_and": "minimum",
    "bitwise_or": "maximum",
}


class _NotRecorded(TypeError):
    """Error of a step that cannot be recorded."""


class _Tape:
    """Operations in the order of their evaluation, and the numbers known before."""

    def __init__(self) -> None:
        self.code: list[tuple[int, int, int, int, int]] = []
        self.numbers: list[float] = []
        self._constants: dict[float, int] = {}
        self._model: LawModel | None = None

    def new(self, shape: Any) -> Recorded:
        """Return an array of new places."""
        count = int(np.prod(shape))
        places = len(self.numbers) + np.arange(count).reshape(shape)
        self.numbers += [0.0] * count
        return Recorded(self, places)

    def places_of(self, value: Any) -> Any:
        """Return the places of the entries of a recorded array, or of an array of numbers."""
        if isinstance(value, Recorded):
            return value.places
        array = np.asarray(value)
        if array.dtype.kind not in "fib":
            raise _NotRecorded("uses values that are no numbers")
        places = [self._constant(number) for number in array.ravel().tolist()]
        return np.array(places, dtype=np.intp).reshape(array.shape)

    def _constant(self, number: float) -> int:
        number = float(number)
        if number not in self._constants:
            self._constants[number] = len(self.numbers)
            self.numbers.append(number)
        return self._constants[number]

    def operate(self, name: str, operands: Any) -> Recorded:
        """Record an operation on the entries of arrays; return its result."""
        if name not in OPERATIONS:
            raise _NotRecorded(f"uses {name}")
        places = np.broadcast_arrays(*map(self.places_of, operands))
        result = self.new(places[0].shape)
        if len(self.code) + result.places.size > _MOST:
            raise _NotRecorded("has too many operations")
        columns = [array.ravel().tolist() for array in (result.places, *places)]
        columns += [columns[-1]] * (4 - len(columns))
        operation = OPERATIONS.index(name)
        self.code += [(operation, *row) for row in zip(*columns, strict=True)]
        return result

    def term(self, name: str, model: LawModel, operands: Any, shape: Any, count: int) -> Recorded:
        """Record a term of a model; ``count`` is the number of its inertial sets."""
        first = model if self._model is None else self._model
        if first.work is not model.work or first.sets is not model.sets:
            raise _NotRecorded("uses several models")
        self._model = first
        places = np.concatenate([self.places_of(value).ravel() for value in operands])
        start = int(self.operate("positive", [Recorded(self, places)]).places[0])
        result, code = self.new(shape), len(OPERATIONS) + TERMS.index(name)
        self.code.append((code, int(result.places.flat[0]), start, start, count))
        return result

    @property
    def model(self) -> LawModel:
        """The model of the law, without bodies if it has none."""
        if self._model is not None:
            return self._model
        nothing = KernelView(empty_constants(0, 0, 0, 0))
        return _law_model(nothing, np.zeros(0, np.intp), _NO_SETS)


class Recorded(np.lib.mixins.NDArrayOperatorsMixin):
    """Array whose entries are places on a tape."""

    __array_priority__ = 1.0

    def __init__(self, tape: _Tape, places: Any) -> None:
        self.tape, self.places = tape, places

    shape = property(lambda self: self.places.shape)
    ndim = property(lambda self: self.places.ndim)
    size = property(lambda self: self.places.size)
    dtype = np.dtype(np.float64)

    def __array__(self, *args: Any, **options: Any) -> Any:
        raise _NotRecorded("uses the numbers of its memory, readings or inputs")

    __bool__ = __float__ = __int__ = __index__ = __array__

    def __len__(self) -> int:
        return len(self.places)

    def __getitem__(self, key: Any) -> Recorded:
        return Recorded(self.tape, np.asarray(self.places[key]))

    def clip(self, min: Any = None, max: Any = None) -> Recorded:
        """Return the entries within limits."""
        limited = self if min is None else self.tape.operate("maximum", [self, min])
        return limited if max is None else self.tape.operate("minimum", [limited, max])

    def copy(self) -> Recorded:
        """Return the array, which never changes."""
        return self

    def ravel(self) -> Recorded:
        """Return the entries in one row."""
        return self.reshape(-1)

    def reshape(self, *shape: Any) -> Recorded:
        """Return the entries in another shape."""
        return Recorded(self.tape, self.places.reshape(*shape))

    def __array_ufunc__(self, ufunc: Any, method: str, *inputs: Any, **options: Any) -> Recorded:
        if method == "accumulate" and ufunc is np.add:
            return self._sums(**options)
        if method != "__call__" or options:
            raise _NotRecorded(f"uses {ufunc.__name__}.{method}")
        return self.tape.operate(_ALIASES.get(ufunc.__name__, ufunc.__name__), inputs)

    def _sums(self, axis: int) -> Recorded:
        """Return the sums of the entries up to each one along an axis."""
        rows = list(np.moveaxis(self.places, axis, 0))
        sums = [Recorded(self.tape, rows[0])]
        for row in rows[1:]:
            sums.append(self.tape.operate("add", (sums[-1], Recorded(self.tape, row))))
        return Recorded(self.tape, np.stack([total.places for total in sums], axis))

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        if function is np.where and len(args) == 3:
            return self.tape.operate("where", args)
        if function is np.clip:
            return args[0].clip(*args[1:], **options)
        if function is np.round and len(args) == 1:
            return self.tape.operate("rint", args)
        if function in (np.shape, np.ndim, np.size):
            return function(self.places)
        if function is np.zeros_like:
            return 0.0 * self
        if function not in _MOVES:
            raise _NotRecorded(f"uses {function.__name__}")
        first = args[0]
        several = isinstance(first, list | tuple)
        places = list(map(self.tape.places_of, first)) if several else self.tape.places_of(first)
        return Recorded(self.tape, np.asarray(function(places, *args[1:], **options)))


#: Sets of a model whose parameters do not change.
_NO_SETS = np.zeros((0, 0, SET_COLUMNS))


def _law_model(kernels: KernelView, bodies: Any, sets: FloatArray) -> LawModel:
    """Return a model with new arrays for its state and its results."""
    joints, state = len(bodies), (kernels.zeros(2), kernels.zeros(), np.zeros(kernels.shape * 2))
    of_joints = bodies, np.zeros((4, joints)), sets, np.zeros((len(sets), joints))
    arm = kernels.sizes, kernels.constants, kernels.loads, kernels.work
    return LawModel(*arm, *state, *of_joints)


def is_recorded(value: object) -> bool:
    """Return whether a value is an array of a program that is being recorded."""
    return isinstance(value, Recorded)


def recorded_term(
    name: str,
    kernels: KernelView,
    operands: Iterable[Any],
    shape: int | tuple[int, ...],
    bodies: Any = (),
    sets: FloatArray = _NO_SETS,
    count: int = 0,
) -> Any:
    """Record a term of the model of a law, see ``kernels.controller_terms.law_program``.

    Args:
        name: of the term. kernels: those of the model.
        operands: coordinates, rates and accelerations of the bodies; or four rows of the joints,
            at least one of them recorded. shape: of the result.
        bodies: of the joints. sets: of their parameters, the first ``count`` of them inertial.
    """
    values = list(operands)
    tape: _Tape = next(value.tape for value in values if isinstance(value, Recorded))
    model = _law_model(kernels, np.asarray(bodies, dtype=np.intp), sets)
    return tape.term(name, model, values, shape, count)


#: Pure step of a loop from memory, signals of the arm and inputs: the next memory; the torques of
#: the law, those that the motors hold, and numbers that results contain, by `LawProgram`'s names.
LoopStep = Callable[[Arrays, Arrays, Arrays], tuple[Arrays, Arrays]]


def program_of(
    law: Controller,
    memory: Arrays,
    signals: Mapping[str, Any],
    inputs: Arrays,
    step: LoopStep | None = None,
) -> LawProgram | None:
    """Return the program of a built-in law; None if its step cannot be recorded.

    ``step`` is that of its loop, or else that of the law itself.
    """
    if not is_law(law) or not all(map(_is_built_in, around(law))):
        return None  # a user's step may note numbers
    step = step or partial(plain_step, law)
    parts = memory, {name: signals[name] for name in SENSED}, inputs
    if any(np.asarray(value).dtype.kind not in "fib" for part in parts for value in part.values()):
        return None
    tape = _Tape()
    recorded: Any = [{name: tape.new(np.shape(v)) for name, v in part.items()} for part in parts]
    try:
        after, results = step(*recorded)
        if after.keys() != memory.keys():
            return None
        ends = {name: tape.places_of(after[name]) for name in memory}
        outputs = {name: tape.places_of(results[name]) for name in ("torque", "held", "noted")}
    except Exception:  # of code that expects numbers
        return None
    if any(ends[name].shape != np.shape(value) for name, value in memory.items()):
        return None
    code, kept = np.array(tape.code, dtype=np.int64).reshape(-1, 5), map(np.size, memory.values())
    after_places = np.concatenate([np.zeros(0, np.int64), *(ends[k].ravel() for k in memory)])
    before, sensed, planned = map(_joined, recorded)
    program = LawProgram(
        code,
        np.array(tape.numbers),
        before,
        sensed,
        planned,
        after_places,
        outputs["torque"].ravel().astype(np.int64),
        np.ascontiguousarray(outputs["held"], np.int64),
        outputs["noted"].ravel().astype(np.int64),
        np.zeros(sum(kept)),
        tape.model,
    )
    with np.errstate(all="ignore"):  # random numbers may be outside the range of a function
        return program if _is_equal(program, step, parts) else None


def plain_step(
    law: Controller, memory: Arrays, signals: Arrays, inputs: Arrays
) -> tuple[Arrays, Arrays]:
    """Return the next memory, and the results of a loop with exact sensors and ideal motors."""
    after, torque = law.step(memory, Measurement(**signals), inputs)
    return after, {"torque": torque, "held": torque.reshape(1, 1, -1), "noted": np.zeros(0)}


def _is_built_in(law: Any) -> bool:
    return type(law).__module__.startswith("flexarm.") and "step" not in vars(law)


def _joined(arrays: Mapping[str, Recorded]) -> Any:
    rows = (array.places.ravel() for array in arrays.values())
    return np.concatenate([np.zeros(0, np.int64), *rows])


def flat(arrays: Arrays) -> FloatArray:
    """Return the numbers of named arrays in one row."""
    return np.concatenate([np.zeros(0), *map(np.ravel, arrays.values())])


def _is_equal(program: LawProgram, step: LoopStep, parts: Any) -> bool:
    """Return whether a program has the results of the step at a sample and at random numbers."""
    rng = np.random.default_rng(0)
    trial = program._replace(numbers=program.numbers.copy())
    places = program.memory, program.readings, program.inputs
    for k in range(1 + _TRIALS):
        drawn = [{name: _moved(value, k, rng) for name, value in part.items()} for part in parts]
        for where, part in zip(places, drawn, strict=True):
            trial.numbers[where] = flat(part)
        law_step(trial)
        after, outputs = step(*drawn)
        results = [trial.numbers[getattr(program, name)] for name in ("after", *outputs)]
        wanted = [flat({name: after[name] for name in drawn[0]}), *outputs.values()]
        kinds = [[np.asarray(part[n]).dtype.kind for n in drawn[0]] for part in (after, drawn[0])]
        if kinds[0] != kinds[1] or not all(map(_same, results, wanted)):
            return False
    return True


def _same(numbers: FloatArray, others: Any) -> bool:
    return np.array_equal(np.ravel(numbers), np.ravel(others))


def _moved(value: Any, k: int, rng: np.random.Generator) -> Any:
    """Return the numbers of trial k: those given first, then random ones of the same type."""
    shape, kind = np.shape(value), np.asarray(value).dtype
    if k == 0:
        return value
    if kind.kind == "f":
        return value + rng.normal(size=shape)
    return rng.integers(2, size=shape).astype(kind)[()] + (0 if kind.kind == "b" else value)
