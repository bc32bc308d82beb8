"""Converters of the arguments of public functions, one for each kind of argument.

Each returns the argument in the type used for computation, or raises an `InputError` that names the
argument; `errors.public_call` adds the call. Arrays of numbers are converted by
`errors.check_array`, motions by `motion.motion.check_motion`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from flexarm.base.errors import (
    ImplausibleValueWarning,
    InputError,
    Problem,
    check_array,
    nearest,
    one_of,
    shown,
    warn_caller,
)
from flexarm.base.late import xr

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

T = TypeVar("T")

#: Positive numbers below this are rejected like zero, because their inverses and products exceed
#: the range of floats.
_SMALLEST = 1e-150
#: Largest length (bytes) of the name of a file or folder, in almost all file systems.
_LONGEST_NAME = 255
#: Variables of datasets that contain text.
_TEXTS = ("controller", "plant", "reference", "failure")
#: Largest plausible joint angle of a posture, rad: two turns.
_TURNS = 4.0 * math.pi
#: Larger angles (rad) than ten turns in degrees are no degrees.
_DEGREES = 3600.0


def check_kind(name: str, value: object, kind: type[T], what: str = "", hint: str = "") -> T:
    """Return the value if it is an instance of a class.

    Args:
        what: description of the class with its article; its name by default.
        hint: a sentence that explains how to create an instance.
    """
    if isinstance(value, kind):
        return value
    article = "an" if kind.__name__[0] in "AEIOU" else "a"
    given = f"the class {value.__name__}" if isinstance(value, type) else shown(value)
    raise InputError(Problem(name, f"be {what or f'{article} {kind.__name__}'}", given, hint))


def check_list_of(name: str, value: object, kind: type[T]) -> list[T]:
    """Return a list of objects of a class, from a list or a tuple."""
    if isinstance(value, list | tuple) and all(isinstance(item, kind) for item in value):
        return list(value)
    raise InputError(Problem(name, f"be a list of {kind.__name__} objects", shown(value)))


def check_positive(name: str, value: object, unit: str = "") -> float:
    """Return a finite number greater than zero; ``unit`` is its unit in the message."""
    if (type(value) is float or type(value) is int) and _SMALLEST <= value < 2.0**63:
        return float(value)
    rule = f"be greater than 0 {unit}".rstrip()
    return check_number(name, value, lambda number: number >= _SMALLEST, rule)


def check_nonnegative(name: str, value: object, most: float = math.inf) -> float:
    """Return a finite number from zero to ``most``."""
    number = check_number(name, value, lambda number: number >= 0.0, "be at least 0")
    if number > most:
        raise InputError(Problem(name, f"be at most {most:g}", shown(value)))
    return number


def check_number(
    name: str, value: object, fits: Callable[[float], bool] = lambda number: True, rule: str = ""
) -> float:
    """Return a finite number that fits a condition; ``rule`` is the condition in the message."""
    number = float(check_array(name, value, ()))
    if not fits(number):
        raise InputError(Problem(name, rule, shown(value)))
    return number


def check_between_0_and_1(name: str, value: object) -> float:
    """Return a number greater than 0 and less than 1."""
    rule = "be greater than 0 and less than 1"
    return check_number(name, value, lambda number: 0.0 < number < 1.0, rule)


def check_tolerance(name: str, value: object) -> float:
    """Return a number greater than 0 and less than 1, such as a relative tolerance."""
    number = check_positive(name, value)
    if number >= 1.0:
        raise InputError(Problem(name, "be less than 1", shown(value)))
    return number


def check_posture(
    name: str, value: object, joints: int, turning: NDArray[np.bool_] | None = None
) -> NDArray[np.float64]:
    """Return relative joint angles (joints,), rad; positions (m) of joints that slide.

    ``turning`` (joints,) names those that turn, by default all; `about_degrees` judges their size.
    """
    angles = check_array(name, value, (joints,))
    warn_of_degrees(**{name: angles if turning is None else angles[turning]})
    return angles


def warn_of_degrees(**angles: Iterable[float]) -> None:
    """Warn once of all arguments whose angles look like degrees.

    Warns:
        ImplausibleValueWarning: see `about_degrees`.
    """
    texts = filter(None, (about_degrees(name, values) for name, values in angles.items()))
    if text := " ".join(texts):
        warn_caller(text, ImplausibleValueWarning)


def about_degrees(name: str, angles: Iterable[float]) -> str:
    """Return a sentence about angles that look like degrees rather than radians; else no text.

    An angle exceeds two turns, and all are multiples of 0.5, which those of an arm that turned
    several times are not.
    """
    values = [abs(float(angle)) for angle in angles]
    largest = max(values, default=0.0)
    if not _TURNS < largest <= _DEGREES or any(2.0 * value % 1.0 for value in values):
        return ""
    return (
        f"{name} contains {largest:.4g} rad, more than two turns, and looks like degrees; "
        "angles are in radians."
    )


def check_each(
    name: str, value: object, count: int = -1, *, positive: bool = False
) -> NDArray[np.float64]:
    """Return a finite number, shape (), or a list of ``count`` numbers; -1: any count but 0."""
    array = _plain_array(value)
    single = array is not None and array.ndim == 0
    numbers = check_array(name, value, () if single else (count,))
    if positive and not (numbers.size and (numbers > 0.0).all()):
        raise InputError(Problem(name, "be greater than 0", shown(value)))
    return numbers


def check_direction(name: str, value: object) -> NDArray[np.float64]:
    """Return the unit vector (2,) of a direction that is given with any length but zero."""
    vector = check_array(name, value, (2,))
    length = math.hypot(*vector)
    if not length > 0.0:
        raise InputError(Problem(name, "have a length greater than 0", shown(value)))
    return vector / length


def as_list(value: object) -> list[Any] | None:
    """Return the items of a list, a tuple or an array; None for anything else."""
    if isinstance(value, list | tuple):
        return list(value)
    array = _plain_array(value) if hasattr(value, "__array__") else None
    return None if array is None or array.ndim == 0 else array.tolist()


def check_count(name: str, value: object, least: int = 1, most: int = 10**6) -> int:
    """Return a whole number from ``least`` to ``most``."""
    import numpy as np

    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        count = int(value)
        if least <= count <= most:
            return count
    raise InputError(Problem(name, f"be a whole number from {least} to {most}", shown(value)))


def check_flag(name: str, value: object) -> bool:
    """Return a truth value, from a Python or NumPy bool."""
    import numpy as np

    if isinstance(value, bool | np.bool_):
        return bool(value)
    raise InputError(Problem(name, "be True or False", shown(value)))


def check_choice(name: str, value: object, choices: Collection[str]) -> str:
    """Return the value if it is one of the allowed words."""
    if isinstance(value, str) and value in choices:
        return value
    rule, hint = one_of(value, choices)
    raise InputError(Problem(name, rule, shown(value), hint))


def check_options(options: Iterable[str], known: Collection[str], function: str) -> None:
    """Check the names of options that a function passes to another one.

    Raises:
        InputError: with a problem for each name that is not ``known``.
    """
    rule = f"is not an argument of {function}"
    wrong = [
        Problem(name, rule, hint=nearest(name, known)) for name in options if name not in known
    ]
    if wrong:
        raise InputError(*wrong)


def check_path(name: str, value: object) -> Path:
    """Return the path of a file that a file system can have, from text or a path object."""
    given = value if isinstance(value, str | PathLike) else None
    try:
        text = fspath(given) if given is not None else None
    except Exception:  # a user-defined path object may raise any exception
        text = None
    if isinstance(text, str) and len(text) < 4096 and "\0" not in text and Path(text).name:
        longest = max(Path(text).parts, key=len)
        if len(longest.encode(errors="surrogatepass")) > _LONGEST_NAME:
            rule = f"have names of at most {_LONGEST_NAME} bytes"
            raise InputError(Problem(name, rule, shown(value)))
        return Path(text)
    raise InputError(Problem(name, "be the path of a file", shown(value)))


def check_function(
    name: str, value: object, what: str = "a function of time"
) -> Callable[..., Any]:
    """Return a callable object that is not a class."""
    if callable(value) and not isinstance(value, type):
        return value
    raise InputError(Problem(name, f"be {what}", shown(value)))


def check_mapping(name: str, value: object, what: str) -> Mapping[Any, Any]:
    """Return a dictionary or another mapping; ``what`` describes its items in the message."""
    if isinstance(value, Mapping):
        return value
    raise InputError(Problem(name, f"be a mapping of {what}", shown(value)))


def check_last_axes(
    name: str, value: Any, last: tuple[int, ...], axes: int | None = None
) -> NDArray[Any]:
    """Return an array of real, complex or symbolic numbers whose last axes have given lengths.

    An array is returned unchanged, whatever the type of its numbers; a list becomes an array of
    floats. Without ``axes`` it may have any number of axes.
    """
    import numpy as np

    numeric = type(value) is np.ndarray and value.dtype.kind in "fcO"
    if numeric and value.dtype.kind == "O":
        try:
            1.0 * value
        except Exception:  # entries that are neither numbers nor symbols
            raise InputError(Problem(name, "be numbers", shown(value))) from None
    array = value if numeric else _plain_array(value)
    if array is not None and array.shape[-len(last) :] == last and axes in (None, array.ndim):
        return array
    lengths = ", ".join(map(str, ("...", *last) if axes is None else ("any", *last)))
    given = shown(value) if array is None else f"of shape {array.shape}"
    raise InputError(Problem(name, f"be numbers of shape ({lengths})", given))


def _plain_array(value: object) -> NDArray[Any] | None:
    """Return a value as an array of floats or complex numbers, or None if it is not numeric."""
    import numpy as np

    try:
        array = np.asarray(value)
    except Exception:  # for example rows of different lengths
        return None
    if isinstance(value, np.ma.MaskedArray) or array.dtype.kind not in "iufc":
        return None
    return array if array.dtype.kind == "c" else array.astype(np.float64, copy=False)


def check_numbers(
    name: str, value: object, rule: str = "be a number or an array of numbers"
) -> NDArray[np.float64]:
    """Return a float64 array of any shape; infinite numbers are allowed.

    Args:
        rule: condition on the argument, for the message.
    """
    import numpy as np

    numbers = _plain_array(value)
    if numbers is None or numbers.dtype.kind == "c" or np.isnan(numbers).any():
        raise InputError(Problem(name, rule, shown(value)))
    return numbers


def check_limits(name: str, value: object) -> NDArray[np.float64]:
    """Return a positive number, or one per joint; infinity means no limit."""
    import numpy as np

    rule = "be a number greater than 0, or one for each joint"
    numbers = check_numbers(name, value, rule)
    if numbers.ndim > 1 or not np.all(numbers > 0.0):
        raise InputError(Problem(name, rule, shown(value)))
    return numbers


def check_times(name: str, value: object) -> NDArray[np.float64]:
    """Return a time or times as a float64 array of any shape; infinite ones are allowed."""
    return check_numbers(name, value, "be a time or an array of times")


def check_dataset(
    name: str, value: object, needed: Iterable[str] = ("time",), what: str = "a result of simulate"
) -> xr.Dataset:
    """Return a dataset that has the variables ``needed``; ``what`` describes it in the message.

    Raises:
        InputError: if the value is not an ``xarray.Dataset``, or lacks one of the variables, or one
            that consists of numbers in the original was replaced by something else.
    """
    dataset = check_kind(name, value, xr.Dataset, what)
    for one in needed:
        if one not in dataset.variables:
            raise InputError(Problem(name, f"be {what}", f"a dataset without {one!r}"))
        kind = dataset[one].dtype.kind
        if one not in _TEXTS and kind not in "biuf":
            raise InputError(
                Problem(name, f"be {what}", f"a dataset with other values than numbers in {one!r}")
            )
    return dataset


def library_missing(name: str, extra: str) -> InputError:
    """Return the error for a library of an extra of this package that is not installed."""
    hint = f"Install it with: pip install 'flexarm[{extra}]'."
    return InputError(Problem(name, "is not installed", hint=hint))
