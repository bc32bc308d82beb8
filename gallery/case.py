"""What a case of the gallery is: a problem, quantities computed and known, and a picture."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

#: Digits that double precision can show; two equal numbers agree to as many.
MOST_DIGITS = 15.0


@dataclass(frozen=True)
class Source:
    """Where a reference value comes from: in a few words for tables, and in full."""

    cite: str
    full: str


@dataclass(frozen=True)
class Row:
    """One quantity: the value that is known beside the value that the package computes.

    Attributes:
        quantity: its name, in words or symbols.
        unit: SI, "1" for a pure number.
        source: of the reference value.
        theirs, ours: reference value and computed value.
        digits_required: how many digits must agree; fractions of a digit count.
        reason: why so many, and not more.
        scale: what a difference is measured against; the reference value where None. A largest
            distance between two curves has the reference value 0 and needs a scale.
    """

    quantity: str
    unit: str
    source: Source
    theirs: float
    ours: float
    digits_required: float
    reason: str
    scale: float | None = None

    @property
    def difference(self) -> float:
        """Difference over scale, signed."""
        scale = abs(self.theirs) if self.scale is None else self.scale
        return (self.ours - self.theirs) / scale

    @property
    def digits_agreed(self) -> float:
        """Number of digits that agree: -log10 |difference|; none where a value is not finite."""
        if not math.isfinite(self.difference):
            return 0.0
        if self.difference == 0.0:
            return MOST_DIGITS
        return min(MOST_DIGITS, -math.log10(abs(self.difference)))

    @property
    def agrees(self) -> bool:
        """Whether enough digits agree."""
        return self.digits_agreed >= self.digits_required


@dataclass(frozen=True)
class Case:
    """A problem with a known answer.

    Attributes:
        name: of its picture, words joined by hyphens.
        title: heading of its section, and its name in the table.
        physics: Markdown; the problem, what is compared, and how the package is called.
        quantities: compute the rows; called once, then remembered by the caller.
        draw: draw the picture into an empty figure.
        caption: what the picture shows, in a sentence or two.
        size: width and height of the picture, inches.
        module: file below the root of the repository that holds the case.
    """

    name: str
    title: str
    physics: str
    quantities: Callable[[], Sequence[Row]]
    draw: Callable[[Figure], None]
    caption: str
    module: str
    size: tuple[float, float] = (6.6, 3.0)


@dataclass(frozen=True)
class Page:
    """Cases on one page.

    Attributes:
        name: of its file, words joined by hyphens. title: its heading. cases: in order.
        introduction: Markdown before the first case.
    """

    name: str
    title: str
    cases: tuple[Case, ...]
    introduction: str = ""


def rounding_digits(value: float, decimals: int) -> float:
    """Digits that a value printed with so many decimals can agree to: half a unit of the last."""
    return -math.log10(0.5 * 10.0**-decimals / abs(value))


def distance_digits(distance: float, scale: float) -> float:
    """Digits that a distance amounts to on a scale, for rows whose reference value is zero."""
    return -math.log10(distance / scale)
