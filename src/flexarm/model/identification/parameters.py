"""Free parameters of an identification."""

from __future__ import annotations

from collections.abc import Iterator

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.quantities import Flag, Number, Positive, Word
from flexarm.model.wording import Fault


class FreeParameter(Record, kw_only=False):
    """A number of an arm or of its motors that is estimated from measured records.

    ``prior`` and ``prior_deviation`` describe what is known before the measurement, as a normal
    distribution; they count as one more measurement.
    """

    path: Word
    """Path of the number, such as links[0].flexural_rigidity or payload.mass."""
    lower: Number | None = None
    """Lower bound; by default 0 if the number cannot be negative."""
    upper: Number | None = None
    """Upper bound; none by default."""
    prior: Number | None = None
    """Expected value; by default that of the arm."""
    prior_deviation: Positive | None = None
    """Standard deviation of the expected value; no prior by default."""
    per_record: Flag = False
    """Whether each record has its own value; shared by default."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("lower", "upper") and given.upper <= given.lower:
            yield Fault(("upper",), f"be greater than lower ({given.lower:g})", shown(given.upper))
        if not given.absent("prior") and given.absent("prior_deviation"):
            yield Fault(("prior_deviation",), "is required with prior")
