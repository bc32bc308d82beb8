"""Types of fields and of arguments: finite numbers, counts, pairs, lists, mappings from names.

A type is declared once for the keys of files, the fields of records and, if it has a `Rule`, the
arguments of functions, which `public_call` validates. Numbers are strict (no text, no booleans),
but NumPy scalars and arrays are accepted as their plain Python values. Lists and tuples are both
accepted and stored as tuples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

from pydantic import AfterValidator, BeforeValidator, Discriminator, Field, Tag

from flexarm.base.arguments import (
    check_between_0_and_1,
    check_count,
    check_flag,
    check_nonnegative,
    check_number,
    check_positive,
    check_tolerance,
)
from flexarm.base.errors import Rule, printable
from flexarm.base.processes import check_workers
from flexarm.model.wording import refuse

T = TypeVar("T")


def plain(value: Any) -> Any:
    """Return the plain numbers or lists of a value of NumPy, xarray or a table, without NumPy."""
    if isinstance(value, type):
        return value
    array = getattr(value, "to_numpy", None)
    convert = getattr(array() if callable(array) else value, "tolist", None)
    return convert() if callable(convert) else value


def _unlimited(value: Any) -> Any:
    return math.inf if value is None else value


def length_of(value: Any) -> int | None:
    """Return the length of a list, a tuple or an array; None for other values."""
    given = plain(value)
    return len(given) if isinstance(given, list | tuple) else None


def _listed(value: Any) -> Any:
    """Return a list, tuple or array; raise for sets, which have no order, and for text."""
    given = plain(value)
    if not isinstance(given, list | tuple):
        raise refuse("be a list", given)
    return given


def _numbers(count: str, length: int, value: Any) -> Any:
    numbers = plain(value)
    if not isinstance(numbers, list | tuple) or len(numbers) != length:
        raise refuse(f"be a list of {count} numbers", numbers)
    return numbers


def must(rule: str, fits: Callable[[Any], bool], hint: str = "") -> AfterValidator:
    """Return the validator of a field with a rule of its own."""

    def check(value: T) -> T:
        if fits(value):
            return value
        raise refuse(rule, list(value) if isinstance(value, tuple) else value, hint)

    return AfterValidator(check)


def either(tag: str, kinds: Any, other: str) -> Discriminator:
    """Return the choice between two members of a union: ``tag`` for plain values of ``kinds``."""
    return Discriminator(lambda value: tag if isinstance(plain(value), kinds) else other)


class Names(dict[str, T]):
    """Immutable mapping from names to values, so that records that contain it are hashable."""

    def __hash__(self) -> int:  # type: ignore[override]
        return hash(frozenset(self.items()))

    def __reduce__(self) -> tuple[Any, ...]:
        return Names, (dict(self),)

    def _refuse(self, *_: object, **__: object) -> Any:
        raise TypeError("this mapping cannot be changed")

    __setitem__ = __delitem__ = __ior__ = update = pop = popitem = clear = setdefault = _refuse


def _named(value: Any) -> Any:
    if not isinstance(value, Mapping) or not value:
        raise refuse("be a mapping with at least one name", value)
    return _mapped(value)


def _mapped(value: Any) -> Any:
    if not isinstance(value, Mapping):
        raise refuse("be a mapping of names", value)
    wrong = [name for name in value if not isinstance(name, str)]
    if wrong:
        raise refuse("have text as names", wrong[0], "Put the name in quotes.")
    unprintable = next((name for name in value if printable(name) != name), None)
    if unprintable is not None:
        raise refuse("have printable names", unprintable)
    return value


def _interval(value: Any) -> Any:
    given = plain(value)
    numbers = [plain(number) for number in given] if isinstance(given, list | tuple) else []
    right = all(isinstance(v, int | float) and not isinstance(v, bool) for v in numbers)
    if not right or len(numbers) != 2 or not numbers[0] <= numbers[1]:
        raise refuse("be two numbers in increasing order", given)
    return numbers


if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler
    from pydantic_core import CoreSchema

    # Input types, so that type checkers accept lists; tuples are stored.
    Listed = Annotated[Sequence[T], ...]
    Named = Annotated[Mapping[str, T], ...]
    Mapped = Annotated[Mapping[str, T], ...]
    Pair = Sequence[float]
    NonNegatives = Sequence[float]
    Direction = Sequence[float]
    Limit = float
    Limits = float | Sequence[float]
else:
    Listed = Annotated[tuple[T, ...], BeforeValidator(_listed)]
    Named = Annotated[dict[str, T], BeforeValidator(_named), AfterValidator(Names)]
    Mapped = Annotated[dict[str, T], BeforeValidator(_mapped), AfterValidator(Names)]  # or empty

# Bounds precede the conversion, so that they apply to the plain number and to the schema.
Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Number = Annotated[Finite, BeforeValidator(plain), Rule(check_number)]
Positive = Annotated[Finite, Field(gt=0), BeforeValidator(plain), Rule(check_positive)]
NonNegative = Annotated[Finite, Field(ge=0), BeforeValidator(plain), Rule(check_nonnegative)]
Fraction = Annotated[Finite, Field(ge=0, le=1), BeforeValidator(plain)]
Probability = Annotated[
    Finite, Field(gt=0, lt=1), BeforeValidator(plain), Rule(check_between_0_and_1)
]
Tolerance = Annotated[Finite, Field(gt=0, lt=1), BeforeValidator(plain), Rule(check_tolerance)]
Count = Annotated[int, Field(strict=True, ge=1), BeforeValidator(plain), Rule(check_count)]
CountOrZero = Annotated[
    int,
    Field(strict=True, ge=0),
    BeforeValidator(plain),
    Rule(partial(check_count, least=0)),
]
Flag = Annotated[bool, Field(strict=True), BeforeValidator(plain), Rule(check_flag)]
Workers = Annotated[int | None, Rule(check_workers)]  # processes or threads; None: one each core
# Files do not support control characters and halves of surrogate pairs.
_PRINTABLE = must("be printable text", lambda text: printable(text) == text)
Word = Annotated[str, Field(strict=True, min_length=1), _PRINTABLE]
Identifier = Annotated[Word, must("be a word of letters, digits and underscores", str.isidentifier)]
Interval = Annotated[tuple[float, float], BeforeValidator(_interval)]
OneOrMany = Annotated[
    Annotated[T, Tag("<number>")] | Annotated[Listed[T], Tag("<list>")],
    either("<list>", list | tuple, "<number>"),
]

# A limit that does not exist is infinite in Python, and missing or null in files.
NO_LIMIT: dict[str, Any] = {"default": None}  # in the schema
if not TYPE_CHECKING:
    Pair = Annotated[tuple[Number, Number], BeforeValidator(partial(_numbers, "two", 2))]
    NonNegatives = Annotated[  # of the three coordinates of a body
        tuple[NonNegative, NonNegative, NonNegative],
        BeforeValidator(partial(_numbers, "three", 3)),
    ]
    Direction = Annotated[Pair, must("have a length greater than 0", any)]
    _Limit = Annotated[float, Field(strict=True, gt=0), BeforeValidator(plain)]  # or infinite
    Limit = Annotated[_Limit | None, AfterValidator(_unlimited)]
    Limits = Annotated[OneOrMany[_Limit] | None, AfterValidator(_unlimited)]


@dataclass(frozen=True, eq=False)
class Typed:
    """Type of the input for a parameter without a static type: ``Annotated[Any, Typed(...)]``."""

    of: Any

    @property
    def annotation(self) -> Any:
        """The type of the input."""
        return self.of

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return handler.generate_schema(self.annotation)


class OneOrEach(Typed):
    """One number or a list of them.

    A constructor in Python takes arrays, too, and its object keeps an array. No static type covers
    all of them.
    """

    @property
    def annotation(self) -> Any:
        """The type of the input."""
        several: Any = OneOrMany
        return several[self.of]


class PerJoint(OneOrEach):
    """One number for all joints of the arm, or a list with one for each."""


class ListPerJoint(PerJoint):
    """A list with one value for each joint of the arm."""

    @property
    def annotation(self) -> Any:
        """The type of the input."""
        several: Any = Listed
        return several[self.of]
