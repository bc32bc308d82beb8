"""What can go wrong, in words: the exceptions every layer raises, and the one format of a problem.

Wrong input is an `InputError` (all its problems at once, each as *where: name must rule, but is
value*); a run whose numbers fail is a `SimulationError`, which keeps what was computed until then;
a state beyond its theory is a `LargeDeflectionWarning`; a run whose sampled loop is unstable is an
`UnstableLoopWarning`.
"""

from __future__ import annotations

import math
import sys
import warnings
from dataclasses import dataclass
from reprlib import Repr
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


class _Short(Repr):
    """Shortened repr in which a whole float looks the way its user most likely wrote it."""

    def repr_float(self, value: float, level: int) -> str:
        return repr(value).removesuffix(".0")


_SHORT = _Short()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 60
_SHORT.maxdict = _SHORT.maxlist = _SHORT.maxtuple = 4
_SHORT.maxlevel = 3

_MOST_LINES = 50  # of a message; the rest are in `problems`


def shown(value: object) -> str:
    """Write `value` on one line, shortened, as error messages quote it.

    NumPy scalars look like the Python numbers they stand for.
    """
    if type(value).__module__ == "numpy" and getattr(value, "ndim", None) == 0:
        value = value.item()  # type: ignore[attr-defined]
    try:
        text = "nothing" if value is None else _SHORT.repr(value)
    except Exception:  # an integer of more digits than Python prints, a repr that fails
        text = f"an object of type {type(value).__name__}"
    return " ".join(text.split())


def printable(text: str) -> str:
    r"""Write control characters, terminal escape codes and the like as Python does: ``\x1b``.

    Names and paths come from users and from files. Printed as they are, they could change the
    title, the colours or the content of a terminal, or reverse the direction of the text.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def few(values: Any, most: int = 4) -> str:
    """Write the first numbers of an array on one line, four digits each, as a repr shows them."""
    first = ", ".join(f"{value + 0.0:.4g}" for value in values[:most])
    return f"{first}, ..." if len(values) > most else first


def is_count(value: object) -> bool:
    """Return whether a value is a whole number of 1 or more; ``True`` is not."""
    import numpy as np

    whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    return whole and int(value) >= 1  # type: ignore[call-overload]


@dataclass(frozen=True)
class Problem:
    """One thing wrong with an input.

    Attributes:
        where: place the reader can go to: a file with its line, or the call (`Link`, `simulate`).
        name: what is wrong there: an argument or the key path in a file.
        rule: what it must do or be, continuing the word "must".
        value: what it is, as `shown` writes it.
        hint: a whole sentence that helps to repair it, or nothing.
    """

    where: str
    name: str
    rule: str
    value: str
    hint: str = ""

    def __str__(self) -> str:
        text = f"{self.where}: {self.name} must {self.rule}, but is {self.value}."
        return printable(f"{text} {self.hint}" if self.hint else text)


class FlexarmError(Exception):
    """Base of everything flexarm raises on purpose."""


class InputError(FlexarmError, ValueError):
    """Input that cannot be used; `problems` lists everything that is wrong with it."""

    def __init__(self, *problems: Problem) -> None:
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        lines = [str(problem) for problem in self.problems[:_MOST_LINES]]
        more = len(self.problems) - len(lines)
        return "\n".join([*lines, f"... and {more} more problems."] if more else lines)


class ModelError(InputError):
    """A wrong description of an arm or a scenario, in Python or in a file."""


class SimulationError(FlexarmError, RuntimeError):
    """A run that could not be carried on.

    Attributes:
        time: simulated time reached (s).
        reason: one sentence: what happened.
        hint: one sentence: what to try; may be empty.
        state: `(q, qd)` at `time`, or None where there is none.
        result: the record up to `time`, or None.
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
    """Base of every warning of this package."""


class AccuracyWarning(FlexarmWarning):
    """A result may err by more than the default settings promise."""


class LargeDeflectionWarning(FlexarmWarning):
    """Links have bent too far for the theory of their arm; the message estimates the error."""


class UnstableLoopWarning(FlexarmWarning):
    """The sampled loop of a controller and the simulated arm is unstable."""


class InconsistentEstimateWarning(FlexarmWarning):
    """Readings depart from a filter's predictions by more than its covariance allows."""


def warn_caller(text: str, category: type[Warning]) -> None:
    """Warn at the line outside this package that led here, however deep the call is."""
    package = __name__.partition(".")[0]
    frame, level = sys._getframe(1), 2
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, category, stacklevel=level)


def warn_deprecated(old: str, new: str, removal: str) -> None:
    """Warn at the caller's line that a public name is deprecated, but still works.

    Args:
        old: the name that the caller used, as in code: `OldClass`, `simulate(old_argument=...)`.
        new: what to use in its place.
        removal: the version that no longer has the old name, such as "0.3".
    """
    text = f"{old} is deprecated and will be removed in flexarm {removal}; use {new}."
    warn_caller(text, DeprecationWarning)


def check_array(
    where: str, name: str, value: object, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return `value` as a float64 array of exactly `shape`, all of it finite.

    Args:
        where: the call that was given the value, for the message.
        name: the argument's name, for the message.
        value: array-like of real numbers.
        shape: lengths of the axes; -1 accepts any length.

    Raises:
        InputError: numbers cannot be made of it, its shape differs, or it holds NaN or infinity.
    """
    import numpy as np

    if type(value) is np.ndarray and value.dtype is np.dtype(np.float64) and value.shape == shape:
        if np.count_nonzero(np.isfinite(value)) == value.size:  # the most frequent argument
            return value.copy(order="K")
    elif type(value) is float and shape == () and math.isfinite(value):
        return np.array(value)
    try:
        raw = np.asarray(value)
    except Exception:  # rows of different lengths, objects that fail to make an array of themselves
        raise InputError(Problem(where, name, f"be {_described(shape)}", shown(value))) from None
    if isinstance(value, np.ma.MaskedArray):
        hint = "Fill or remove the masked elements first."
        raise InputError(Problem(where, name, "not be a masked array", shown(value), hint))
    if raw.dtype.kind not in "iuf":
        raise InputError(Problem(where, name, f"be {_described(shape)}", shown(value)))
    if raw.ndim != len(shape) or any(
        n not in (-1, m) for n, m in zip(shape, raw.shape, strict=True)
    ):
        raise InputError(Problem(where, name, f"be {_described(shape)}", _described(raw.shape)))
    array = raw.astype(np.float64)
    if not np.all(np.isfinite(array)):
        first = np.argwhere(~np.isfinite(array))[0].tolist()
        place = f"[{', '.join(map(str, first))}]" if first else ""
        bad = shown(float(array[tuple(first)]))
        raise InputError(Problem(where, f"{name}{place}", "be finite", bad))
    return array


def check_result(where: str, result: NDArray[np.float64], *given: object) -> NDArray[np.float64]:
    """Return a result computed of the arguments `given`, or say that it is not finite.

    Raises:
        InputError: an argument is too large to compute with, or the mass matrix is singular.
    """
    import numpy as np

    if np.isfinite(result).all():
        return result
    arrays = [np.asarray(value, dtype=np.float64) for value in given if value is not None]
    largest = max(float(np.abs(array).max(initial=0.0)) for array in arrays)
    hint = f"The largest number given is {largest:.3g}."
    if largest < 1e50:
        hint += " If that is not too much, a joint feels no inertia in this posture."
    raise InputError(Problem(where, "the result", "be finite", "infinite or undefined", hint))


def _described(shape: tuple[int, ...]) -> str:
    """Name a shape in words: `a number`, or `numbers of shape (any, 2)`."""
    if not shape:
        return "a number"
    lengths = ", ".join("any" if n == -1 else str(n) for n in shape)
    return f"numbers of shape ({lengths}{',' if len(shape) == 1 else ''})"
