"""Description of what a study varies: distributions of numbers, and the plan of its samples."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flexarm.base.errors import shown
from flexarm.model.checks import Given, Record
from flexarm.model.drives import CONTROLLED
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    Mapped,
    Number,
    Positive,
    Probability,
    Word,
    plain,
)
from flexarm.model.wording import Fault

#: Samples of a study, which bounds the size of its index.
MOST_SAMPLES = 10**10
Seed = Annotated[int, Field(strict=True, ge=0, le=2**63 - 1), BeforeValidator(plain)]
#: Samples of a level of subset simulation, of which a tenth starts chains.
LevelSize = Annotated[int, Field(strict=True, ge=100, le=10**6), BeforeValidator(plain)]


class _Distribution(Record):
    """Base of distributions."""

    relative: Flag = False
    """Whether the numbers are factors of the value in the file."""


class _Range(_Distribution):
    """Base of distributions between two bounds."""

    levels: Count = 5
    """Number of values in a grid, with both bounds."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("low", "high") and given.high <= given.low:
            yield Fault(("high",), f"be greater than low, {given.low:g}", shown(given.high))


class UniformDistribution(_Range):
    """Equally likely values between two bounds."""

    kind: Literal["uniform"] = "uniform"
    low: Number
    """Lower bound, in the unit of the number."""
    high: Number
    """Upper bound, in the unit of the number."""


class LogUniformDistribution(_Range):
    """Values whose logarithm is uniform between two bounds."""

    kind: Literal["log_uniform"] = "log_uniform"
    low: Positive
    """Lower bound, in the unit of the number."""
    high: Positive
    """Upper bound, in the unit of the number."""


class NormalDistribution(_Distribution):
    """Values of a normal distribution; not in a grid."""

    kind: Literal["normal"] = "normal"
    mean: Number
    """Mean, in the unit of the number."""
    deviation: Positive
    """Standard deviation, in the unit of the number."""


class ListedValues(_Distribution):
    """Values of a list, equally likely, or all of them in a grid."""

    kind: Literal["values"] = "values"
    values: Listed[Number] = Field(json_schema_extra={"minItems": 1})
    """The values, in the unit of the number."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("values") and not given.values:
            yield Fault(("values",), "must not be empty")


Distribution = Annotated[
    UniformDistribution | LogUniformDistribution | NormalDistribution | ListedValues,
    Field(discriminator="kind"),
]


class StopRule(Record):
    """Precision of a quantile of a metric at which a study ends."""

    metric: Word
    """Name of the metric, for all drives, plants and motions."""
    quantile: Probability = 0.95
    """Probability of the quantile."""
    within: Positive = 0.05
    """Half the width of its interval, divided by the quantile."""
    confidence: Probability = 0.95
    """Probability that the interval contains the quantile."""


class SamplePlan(Record):
    """Number and choice of the samples of a study."""

    method: Literal["latin_hypercube", "sobol", "random", "grid"] = "latin_hypercube"
    """Choice of the samples; a grid has all combinations."""
    count: Count | None = None
    """Number of samples; a grid has its own number."""
    seed: Seed = 0
    """Seed of the samples and of their noise."""
    noise: Literal["same", "different"] = "same"
    """Whether all samples have the same noise of the hardware, or each its own."""
    stop: StopRule | None = None
    """When fewer samples than `count` suffice; not with a grid."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if not given.has("method"):
            return
        if given.method == "grid" and not given.absent("count"):
            hint = "The levels of the distributions determine it."
            yield Fault(("count",), "cannot be combined with a grid", hint=hint)
        if given.method == "grid" and not given.absent("stop"):
            yield Fault(("stop",), "cannot be combined with a grid")
        if given.method != "grid" and given.absent("count"):
            yield Fault(("count",), f"is required with method {given.method}")


class RareFailures(Record):
    """Failures whose probability is estimated by subset simulation."""

    limits: Mapped[Positive] = Field(default={}, validate_default=True)
    """Largest acceptable metrics by name; runs that stop early fail without one."""
    samples: LevelSize = 1000
    """Samples of each level; a level reaches a tenth further."""
    seed: Seed = 0
    """Seed of the samples."""


def _hardware(given: Given) -> list[Any]:
    """Return the hardware of each plant of a study with valid plants: its own or the study's."""
    shared = given.hardware if given.has("hardware") else None
    return [plant.hardware or shared for plant in given.plants.values()]


def _without_noise(given: Given) -> bool:
    """Return whether no noise acts on any drive of a valid study."""
    if not given.has("drives", "plants") or not (given.absent("hardware") or given.has("hardware")):
        return False
    parts = [item for item in _hardware(given) if item is not None]
    noisy = any(item.noise > 0.0 for part in parts for item in part.instruments or ())
    return not noisy or all(drive.kind not in CONTROLLED for drive in given.drives.values())


def sampling_faults(given: Given) -> Iterator[Fault]:
    """Yield the faults between the distributions, the plan and the hardware of a study."""
    if not given.has("vary"):
        return
    vary: Mapping[str, Any] = given.vary
    rare = not given.absent("rare_failures")
    if rare and not vary:
        yield Fault(("vary",), "is required with rare_failures")
    if vary and given.absent("samples") and not rare:
        yield Fault(("samples",), "is required with vary")
    if not given.has("samples"):
        return
    plan: SamplePlan = given.samples
    if not vary and plan.method == "grid":
        yield Fault(("vary",), "is required with a grid")
    bare = given.absent("hardware") and given.has("plants") and not any(_hardware(given))
    if plan.noise == "different" and bare:
        yield Fault(("samples", "noise"), "requires hardware, whose noise it is")
    elif not vary and plan.noise == "same" and (plan.count or 1) > 1:
        hint = "All samples would be equal. Give each its own noise with `noise: different`."
        yield Fault(("vary",), f"is required with {plan.count} samples", hint=hint)
    elif not vary and plan.noise == "different" and _without_noise(given):
        hint = "All samples would be equal, because no drive reads an instrument with `noise`."
        yield Fault(("vary",), "is required without noise", hint=hint)
    count = plan.count or 1
    for name, item in vary.items() if plan.method == "grid" else ():
        if isinstance(item, NormalDistribution):
            yield Fault(("vary", name, "kind"), "is not supported with a grid", shown("normal"))
            return
        count *= len(item.values) if isinstance(item, ListedValues) else item.levels
    if count > MOST_SAMPLES:
        yield Fault(("samples",), f"be at most {MOST_SAMPLES:.0e} samples", f"{count:.3g}")
