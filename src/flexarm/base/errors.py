"""Exceptions and warnings of all layers, and the common format of a problem.

Wrong input raises an `InputError` with all its problems, each in the form *where: name must rule,
got value* or, if the value does not explain the problem, *where: name statement*. A run that fails
numerically raises a `SimulationError`, which contains the results up to that time. A state beyond
the validity of its theory gives a `LargeDeflectionWarning`; a run with an unstable sampled loop
gives an `UnstableLoopWarning`.
"""

from __future__ import annotations

import inspect
import math
import sys
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from functools import wraps
from reprlib import Repr
from typing import TYPE_CHECKING, Any, NamedTuple, ParamSpec, Self, TypeVar

if TYPE_CHECKING:
    from types import FrameType

    import numpy as np
    from numpy.typing import NDArray


class _Short(Repr):
    """Shortened repr that shows a whole float without its decimals, as users usually write it."""

    def repr_float(self, value: float, level: int) -> str:
        return repr(value).removesuffix(".0")


_SHORT = _Short()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_SHORT.maxdict = _SHORT.maxlist = _SHORT.maxtuple = 4
_SHORT.maxlevel = 3

# Common symbols for our keys, which are too short or too different for a spelling comparison.
_SYNONYMS = {
    "e": "youngs_modulus",
    "ei": "flexural_rigidity",
    "g": "gravity",
    "kd": "derivative",
    "kga": "shear_rigidity",
    "ki": "integral",
    "kp": "proportional",
    "l": "length",
    "mu": "mass_per_length",
    "nel": "elements",
    "nu": "poissons_ratio",
    "rho": "density",
    "rhoa": "mass_per_length",
}

_FEW = 8  # choices that a rule lists
NAMES = "They are "  # beginning of a list of choices in a hint
_MOST_LINES = 50  # maximum number of lines of a message; `problems` contains all


def shown(value: object) -> str:
    """Format `value` on one line, shortened, for quotation in error messages.

    NumPy scalars are shown as Python numbers.
    """
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        value = value.item()  # type: ignore[attr-defined]
    try:
        plain = type(value).__repr__ is object.__repr__  # an address says nothing
        text = f"an object of type {type(value).__name__}" if plain else _SHORT.repr(value)
        text = "nothing" if value is None else text
    except Exception:  # an integer with too many digits to print, or a repr that fails
        text = f"an object of type {type(value).__name__}"
    return " ".join(text.split())


def printable(text: str) -> str:
    r"""Escape control characters, such as terminal escape codes, as Python does: ``\x1b``.

    Names and paths come from users and from files. Printed unchanged, they could alter the title,
    the colours or the content of a terminal, or reverse the direction of the text.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def few(values: Any, most: int = 4) -> str:
    """Format the first numbers of an array on one line for a repr, with four digits each."""
    first = ", ".join(f"{value + 0.0:.4g}" for value in values[:most])
    return f"{first}, ..." if len(values) > most else first


def suggestion(word: str, known: Iterable[str]) -> str:
    """Return a sentence with the key or choice most similar to `word`, or with all of them."""
    import difflib

    choices = list(known)
    synonym = _SYNONYMS.get(word.lower())
    if synonym in choices:
        return f"Did you mean {synonym!r}?"
    by_case = {choice.lower(): choice for choice in choices}
    near = difflib.get_close_matches(word.lower(), by_case)
    if near:
        # Among equally similar ones take the one with the same beginning: arm for arn, not run.
        best = max(near, key=lambda choice: _likeness(word.lower(), choice))
        return f"Did you mean {by_case[best]!r}?"
    return f"Known: {', '.join(choices)}." if choices else ""


def nearest(word: object, known: Iterable[str]) -> str:
    """Return a sentence with the choice most similar to `word`, or an empty string."""
    near = suggestion(word, known) if isinstance(word, str) else ""
    return near if near.startswith("Did") else ""


def one_of(value: object, choices: Collection[str], before: str = "") -> tuple[str, str]:
    """Return the rule of a choice and a hint; a long list of names follows the most similar one.

    ``before`` is another kind of allowed value, such as "a Sensor or ".
    """
    near, names = nearest(value, choices), ", ".join(map(repr, choices))
    if len(choices) <= _FEW:
        return f"be {before}one of {names}", near
    return f"be {before}one of {len(choices)} names", f"{near} {NAMES}{names}.".lstrip()


def with_nearest(error: AttributeError, name: str, known: Iterable[str]) -> AttributeError:
    """Return the error of a module without the attribute `name`, with the most similar one."""
    hint = "" if name.startswith("_") else nearest(name, known)
    return AttributeError(f"{error}. {hint}" if hint else str(error))


def _likeness(word: str, choice: str) -> tuple[float, int]:
    """Return the similarity of two words, and the number of equal letters at their beginning."""
    import difflib

    ratio = difflib.SequenceMatcher(a=choice, b=word).ratio()
    alike = [a == b for a, b in zip(word, choice, strict=False)]
    return ratio, [*alike, False].index(False)


@dataclass(frozen=True)
class Problem:
    """One problem of an input.

    Attributes:
        name: argument, or key path in a file.
        rule: condition on it, continuing the word "must"; without a value, a statement about it
            that starts with a verb: "is missing", "cannot be combined with step".
        value: the actual value, formatted by `shown`, or empty.
        hint: a full sentence that helps to correct it, or empty.
        where: its place: a line of a file, or the call (`Link`, `simulate`), which `public_call`
            adds.
    """

    name: str
    rule: str
    value: str = ""
    hint: str = ""
    where: str = ""

    @property
    def statement(self) -> str:
        """The problem without its location: *name must rule, got value. hint*."""
        text = f"must {self.rule}, got {self.value}" if self.value else self.rule
        text = f"{self.name} {text}"
        text = text if text.endswith(".") else f"{text}."  # as of a list that is cut short
        return printable(f"{text} {self.hint}" if self.hint else text)

    def __str__(self) -> str:
        return f"{printable(self.where)}: {self.statement}" if self.where else self.statement


class FlexarmError(Exception):
    """Base class of all exceptions that flexarm raises intentionally."""


class InputError(FlexarmError, ValueError):
    """Input that cannot be used; `problems` lists all its problems."""

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        lines = [str(problem) for problem in self.problems[:_MOST_LINES]]
        more = len(self.problems) - len(lines)
        return "\n".join([*lines, f"... and {more} more problems."] if more else lines)

    def at(self, where: str) -> Self:
        """Add a place to the problems that have none, and return this error."""
        self.problems = tuple(p if p.where else replace(p, where=where) for p in self.problems)
        self.args = self.problems
        return self


def problems_of(check: Callable[..., object], *arguments: object) -> tuple[Problem, ...]:
    """Return the problems that a check raises as an `InputError`; none if it returns."""
    try:
        check(*arguments)
    except InputError as error:
        return error.problems
    return ()


def raise_any(problems: Collection[Problem]) -> None:
    """Raise an `InputError` if there are problems."""
    if problems:
        raise InputError(*problems)


P = ParamSpec("P")
R = TypeVar("R")

#: Methods for which the name of the class stands for the call.
_NAMELESS = ("__init__", "__post_init__", "__call__", "__getitem__")


def public_call(function: Callable[P, R]) -> Callable[P, R]:
    """Decorate a public function, method or constructor: its name becomes the place of problems.

    The place is the name of a function, ``simulate``, or of a constructor's class, ``Plant``; that
    of a method contains the class of its object: ``Arm.tip``. Other decorators are above this one.
    A problem that has a place keeps it: a line of a file, or the public call within this one whose
    argument is wrong. The reasons are in decision 0026. A number beyond the range of floats is a
    problem of the arguments. Arguments whose type has a `Rule` are validated and converted by it.
    """
    return _named(function, "")


def public_call_as(place: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return `public_call` with another place than the function's name, such as ``plot.modes``."""
    return lambda function: _named(function, place)


def _named(function: Callable[P, R], place: str) -> Callable[P, R]:
    names = _keywords(function)
    rules: list[tuple[str, int, Callable[[str, Any], Any]]] | None = None

    @wraps(function)
    def call(*args: P.args, **kwargs: P.kwargs) -> R:
        nonlocal rules
        try:
            if kwargs and names is not None and not kwargs.keys() <= names:
                raise unknown_arguments(kwargs, names)
            if rules is None:  # at the first call, so that the import does not wait
                rules = _rules(function)
            if not rules:
                return function(*args, **kwargs)
            values: list[Any] = list(args)
            named: dict[str, Any] = kwargs
            for name, index, check in rules:
                if name in named:
                    named[name] = check(name, named[name])
                elif index < len(values):
                    values[index] = check(name, values[index])
            return function(*values, **named)
        except InputError as error:
            error.at(place or _place(function, args))
            raise
        except OverflowError as error:  # Python's floats and integers raise it, NumPy's do not
            rule = f"contain a number that is too large ({error})"
            where = place or _place(function, args)
            raise InputError(Problem("the arguments", rule, where=where)) from error

    return call


@dataclass(frozen=True)
class Rule:
    """Rule of the arguments whose type is annotated with it, see `flexarm.model.quantities`.

    Attributes:
        check: function from name and value of an argument to the converted value; it raises an
            `InputError` for a value that the rule does not permit.
    """

    check: Callable[[str, Any], Any]

    def or_none(self, name: str, value: Any) -> Any:
        """Return None for None, and else the converted value."""
        return None if value is None else self.check(name, value)


def _rules(function: Callable[..., object]) -> list[tuple[str, int, Callable[[str, Any], Any]]]:
    """Return name, index and check of each argument whose type has a rule."""
    plain: Any = inspect.unwrap(function)
    code, rules = plain.__code__, []
    for name, annotation in plain.__annotations__.items():
        kind, optional = annotation, ""
        if isinstance(annotation, str):  # a name, or one of another type
            word, optional, _ = annotation.partition(" | None")
            kind = plain.__globals__.get(word)
        for rule in getattr(kind, "__metadata__", ()):
            if isinstance(rule, Rule) and name != "return":
                index = code.co_varnames.index(name)
                index = index if index < code.co_argcount else sys.maxsize  # by keyword only
                rules.append((name, index, rule.or_none if optional else rule.check))
    return rules


def unknown_arguments(names: Iterable[str], known: Collection[str]) -> ArgumentError:
    """Return the error for the keyword arguments of a call that are not ``known``."""
    unknown = [name for name in names if name not in known]
    return ArgumentError(
        *(Problem(name, "is not an argument", hint=suggestion(name, known)) for name in unknown)
    )


def _keywords(function: Callable[..., object]) -> frozenset[str] | None:
    """Return the names of the keyword arguments that a function accepts; None if it accepts all.

    They are read from its code, because ``inspect.signature`` takes longer for hundreds of calls.
    """
    code = inspect.unwrap(function).__code__
    if code.co_flags & inspect.CO_VARKEYWORDS:
        return None
    count = code.co_argcount + code.co_kwonlyargcount
    return frozenset(code.co_varnames[code.co_posonlyargcount : count]) - {"self", "cls"}


def _place(function: Callable[..., object], args: tuple[object, ...]) -> str:
    owner, _, name = function.__qualname__.rpartition(".")
    if not owner:
        return name
    kind = args[0] if isinstance(args[0], type) else type(args[0])
    return kind.__name__ if name in _NAMELESS else f"{kind.__name__}.{name}"


class ArgumentError(InputError, TypeError):
    """A call with a keyword argument that the function does not have."""


class ModelError(InputError):
    """Invalid description of an arm or a scenario, in Python or in a file."""


class SimulationError(FlexarmError, RuntimeError):
    """A run that could not be continued.

    Attributes:
        time: simulated time reached (s).
        reason: one sentence that describes the failure.
        hint: one sentence with a remedy; may be empty.
        state: `(q, qd)` at `time`, or None if not available.
        result: the results up to `time`, or None.
    """

    def __init__(
        self, time: float, reason: str, hint: str = "", state: Any = None, result: Any = None
    ) -> None:
        super().__init__(time, reason, hint, state, result)
        self.time = time
        self.reason = reason
        self.hint = hint
        self.state = state
        self.result = result

    def __str__(self) -> str:
        text = f"stopped at t = {self.time:.6g} s: {self.reason}"
        return printable(f"{text} {self.hint}" if self.hint else text)


class FlexarmWarning(UserWarning):
    """Base class of all warnings of this package."""


class AccuracyWarning(FlexarmWarning):
    """The error of a result may exceed that of the default settings."""


class LimitWarning(FlexarmWarning):
    """Motors, instruments, stops or contacts are far beyond their limits during a run."""


class LargeDeflectionWarning(FlexarmWarning):
    """Links bend too far, or have too large axial loads, for the theory of their arm.

    The message estimates the error.
    """


class UnstableLoopWarning(FlexarmWarning):
    """The loop of a controller and the arm, simulated or of its design, is unstable."""


class InconsistentEstimateWarning(FlexarmWarning):
    """Measurements differ from a filter's predictions by more than its covariance allows."""


class ConvergenceWarning(AccuracyWarning):
    """An iteration ended before it converged."""


class IdentifiabilityWarning(FlexarmWarning):
    """Measured data do not determine some of the parameters that are estimated from them."""


class ImplausibleValueWarning(FlexarmWarning):
    """A number is physically implausible, as if it were in another unit."""


class _Keeper(NamedTuple):
    """The list in which `kept_warnings` collects a kind, and the keeper around this one."""

    kind: type[Warning]
    kept: list[tuple[str, type[Warning]]]
    outer: _Keeper | None


_KEEPER: ContextVar[_Keeper | None] = ContextVar("flexarm_keeper", default=None)


def warn_caller(text: str, category: type[Warning]) -> None:
    """Warn at the nearest calling line outside this package, at any depth of the call."""
    keeper = _KEEPER.get()
    while keeper is not None:
        if issubclass(category, keeper.kind):
            keeper.kept.append((text, category))
            return
        keeper = keeper.outer
    inside = (__name__.partition(".")[0], "contextlib")
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in inside:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


@contextmanager
def kept_warnings(kind: type[Warning] = Warning) -> Iterator[list[tuple[str, type[Warning]]]]:
    """Collect the warnings of one kind that the calls within report, with their categories."""
    kept: list[tuple[str, type[Warning]]] = []
    token = _KEEPER.set(_Keeper(kind, kept, _KEEPER.get()))
    try:
        yield kept
    finally:
        _KEEPER.reset(token)


@contextmanager
def without_warnings(kind: type[Warning] = FlexarmWarning) -> Iterator[None]:
    """Ignore warnings of a kind, by default all of this package, of the calls within."""
    with kept_warnings(kind), warnings.catch_warnings():  # the latter: those of other packages
        warnings.simplefilter("ignore", kind)
        yield


def called_by_user() -> bool:
    """Return whether the public function that calls this one was called from outside the package.

    Inside it, arms are variations of an arm that the user has described.
    """
    frame: FrameType | None = sys._getframe(2)
    while frame is not None and frame.f_globals.get("__name__") == __name__:  # `public_call`
        frame = frame.f_back
    name = "" if frame is None else frame.f_globals.get("__name__", "")
    return str(name).partition(".")[0] != __name__.partition(".")[0]


def warn_deprecated(old: str, new: str, removal: str) -> None:
    """Warn at the caller's line that a public name is deprecated but still works.

    Args:
        old: the name that the caller used, as in code: `OldClass`, `simulate(old_argument=...)`.
        new: its replacement.
        removal: the version that removes the old name, such as "0.3".
    """
    text = f"{old} is deprecated and will be removed in flexarm {removal}; use {new}."
    warn_caller(text, DeprecationWarning)


def check_array(name: str, value: object, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """Return `value` as a float64 array with finite numbers; -1 in `shape` accepts any length."""
    import numpy as np

    exact = shape if shape != (-1,) else (getattr(value, "size", 0),)
    if type(value) is np.ndarray and value.dtype.kind == "f" and value.shape == exact:
        if np.count_nonzero(np.isfinite(value)) == value.size:  # fast path for the most common case
            return value.astype(np.float64)
    elif type(value) is float and shape == () and math.isfinite(value):
        return np.array(value)
    try:
        raw = np.asarray(value)
    except Exception:  # rows of different lengths, or objects whose conversion fails
        raise InputError(Problem(name, f"be {_described(shape)}", shown(value))) from None
    if isinstance(value, np.ma.MaskedArray):
        hint = "Fill or remove the masked elements first."
        raise InputError(Problem(name, "is a masked array", hint=hint))
    if raw.dtype.kind not in "iuf":
        raise InputError(Problem(name, f"be {_described(shape)}", shown(value)))
    if raw.ndim != len(shape) or any(
        n not in (-1, m) for n, m in zip(shape, raw.shape, strict=True)
    ):
        raise InputError(Problem(name, f"be {_described(shape)}", _described(raw.shape)))
    array = raw.astype(np.float64)
    if not np.all(np.isfinite(array)):
        first = np.argwhere(~np.isfinite(array))[0].tolist()
        place = f"[{', '.join(map(str, first))}]" if first else ""
        bad = shown(float(array[tuple(first)]))
        raise InputError(Problem(f"{name}{place}", "be finite", bad))
    return array


def check_result(result: NDArray[np.float64], *given: object) -> NDArray[np.float64]:
    """Return a result computed from the arguments `given` if it is finite.

    Raises:
        InputError: if it is not finite: an argument is too large, or the mass matrix is singular.
    """
    import numpy as np

    if np.isfinite(result).all():
        return result
    arrays = [np.asarray(value, dtype=np.float64) for value in given if value is not None]
    largest = max(float(np.abs(array).max(initial=0.0)) for array in arrays)
    hint = f"The largest number given is {largest:.3g}."
    if largest < 1e50:
        hint += " If that is reasonable, the mass matrix is singular in this posture."
    raise InputError(Problem("the result", "is not finite", hint=hint))


def _described(shape: tuple[int, ...]) -> str:
    """Describe a shape in words: `a number`, or `numbers of shape (any, 2)`."""
    if not shape:
        return "a number"
    lengths = ", ".join("any" if n == -1 else str(n) for n in shape)
    return f"numbers of shape ({lengths}{',' if len(shape) == 1 else ''})"
