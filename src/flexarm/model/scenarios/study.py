"""Description of a study, which compares drives on plants along motions, and what it varies."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Annotated, Any, ClassVar, Literal

from pydantic import BeforeValidator, Field, ValidationError

from flexarm.base.errors import InputError, shown
from flexarm.model import environment
from flexarm.model.arm.joints import Friction
from flexarm.model.arm.spec import ArmSpec, varied_spec
from flexarm.model.checks import Given, Record, faults_of
from flexarm.model.drives import CONTROLLED, Drive, in_volts
from flexarm.model.hardware import Hardware, instrument_faults
from flexarm.model.quantities import (
    Count,
    Flag,
    Listed,
    Mapped,
    Named,
    NonNegative,
    Number,
    OneOrMany,
    Positive,
    Probability,
    Word,
    plain,
)
from flexarm.model.scenarios.motions import MotionSpec
from flexarm.model.scenarios.scenario import RunSpec, Scenario
from flexarm.model.wording import Fault, Path

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


class PlantSpec(Record):
    """Differences between the simulated arm and the model in the controllers."""

    payload_factor: NonNegative = 1.0
    """Factor of the mass and inertia of the payload."""
    payload_mass: NonNegative | None = None
    """Mass of the payload, instead of a factor (kg)."""
    flexural_rigidity_factor: OneOrMany[Positive] = 1.0
    """Factor of the flexural rigidity, one for all links or one for each."""
    mass_factor: OneOrMany[Positive] = 1.0
    """Factor of the mass per length, one for all links or one for each."""
    friction: Friction | None = None
    """Friction of every joint that is not fixed."""
    loads: Listed[environment.Load] = ()
    """Forces and moments that act on this plant alone."""
    changes: Listed[environment.Change] = ()
    """Numbers of this plant that change during each run."""
    hardware: Hardware | None = None
    """Instruments and motors of this plant, in place of those of the study."""


#: Keys of a plant that are not factors of the arm.
_NOT_OF_ARM = ("loads", "changes", "hardware")


class StudyRun(Record):
    """Duration and integrator of each run, and the time after which it counts as settled."""

    duration: Positive
    """Simulated time of each run (s)."""
    rate: Positive | None = None
    """Samples per second used for the metrics (Hz); by default as for a run."""
    settling: NonNegative = 0.0
    """Time after the end of a motion that is excluded from settled error and residual vibration
    (s); less than the duration."""
    integrator: Word = "auto"
    """Name of the integrator."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("duration", "settling") and given.settling >= given.duration:
            rule = f"be less than the duration of {given.duration:g} s"
            yield Fault(("settling",), rule, shown(given.settling))

    def settings(self) -> RunSpec:
        """Return these settings for a single run."""
        return RunSpec(duration=self.duration, rate=self.rate, integrator=self.integrator)


#: Keys that every scenario of a study shares.
_SHARED = ("hardware", "loads", "contacts")


class StudySpec(Record):
    """All drives on all plants along all motions, for all samples if numbers vary."""

    arm: ArmSpec
    """The arm that the drives use as their model."""
    motions: Named[MotionSpec]
    """Reference motions by name."""
    drives: Named[Drive]
    """Sources of the joint torques, by name."""
    plants: Named[PlantSpec] = Field(default={"as believed": PlantSpec()}, validate_default=True)
    """Arms that are simulated, by name."""
    hardware: Hardware | None = None
    """Instruments and motors of every drive that is a controller."""
    loads: Listed[environment.Load] = ()
    """Forces and moments that act on the links."""
    contacts: Listed[environment.Contact] = ()
    """Contacts of points of the arm with surfaces."""
    vary: Mapped[Distribution] = Field(default={}, validate_default=True)
    """Numbers that differ from sample to sample, by their path: in the simulated arms, such as
    `payload.mass`, or in this file, such as `run.duration`."""
    samples: SamplePlan | None = None
    """Number and choice of the samples; required with `vary` alone."""
    rare_failures: RareFailures | None = None
    """Failures that are too rare for samples; `vary` is required."""
    run: StudyRun
    """Settings of the runs and of their metrics."""

    _hints: ClassVar[dict[str, str]] = {
        "run": "It says how long to simulate, for example `run: {duration: 2}`.",
    }

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        yield from _unfit_plants(given)
        yield from sampling_faults(given)
        if not given.has("arm", "motions", "drives", "run"):
            return
        if not all(given.absent(name) or given.has(name) for name in _SHARED):
            return  # their own faults are reported
        reported: set[Fault] = set()
        for drive, motion in product(given.drives, given.motions):
            for fault in _of_one(given, drive, motion):
                if fault not in reported:
                    reported.add(fault)
                    yield fault

    def scenario(self, drive: str, motion: str) -> Scenario:
        """Return the scenario of one drive along one motion, on the arm without variation."""
        return Scenario(**_content(self, drive, motion))


def _of_one(given: Given, drive: str, motion: str) -> Iterator[Fault]:
    """Yield the faults of the scenario of one drive and one motion, with paths in the study."""
    try:
        Scenario.model_validate(_content(given, drive, motion))
    except ValidationError as error:
        for fault in faults_of(error):
            path = placed(fault.path, drive, motion)
            yield Fault(path, fault.rule, fault.value, fault.hint)


def placed(path: Path, drive: str, motion: str) -> Path:
    """Return the key path in a study for a key path in one of its scenarios."""
    for head, place in (("drive", ("drives", drive)), ("motion", ("motions", motion))):
        if path[:1] == (head,):
            return (*place, *path[1:])
    return path


def _content(source: Any, drive: str, motion: str) -> dict[str, Any]:
    chosen = source.drives[drive]
    content = {"arm": source.arm, "motion": source.motions[motion], "drive": chosen}
    content |= {"loads": source.loads or (), "contacts": source.contacts or ()}
    if chosen.kind in CONTROLLED:
        content["hardware"] = source.hardware
    return {**content, "run": source.run.settings()}


def _unfit_plants(given: Given) -> Iterator[Fault]:
    if not given.has("arm", "plants"):
        return
    volts = given.has("drives") and any(map(in_volts, given.drives.values()))
    for name, plant in given.plants.items():
        for fault in environment.motor_change_faults(plant.changes) if volts else ():
            yield fault.inside("plants", name)
        try:
            simulated = plant_spec(given.arm, plant)
            for fault in environment.file_change_faults(simulated, plant.changes, ()):
                yield fault.inside("plants", name)
        except InputError as error:
            for problem in error.problems:
                path = ("plants", name, problem.name)
                value = shown(getattr(plant, problem.name)) if problem.value else ""
                yield Fault(path, problem.rule, value, problem.hint)
        for fault in environment.off_the_arm(given.arm, plant.loads):
            yield fault.inside("plants", name)
        if plant.hardware is not None:
            touches = not given.has("contacts") or bool(given.contacts)
            for fault in instrument_faults(given.arm, plant.hardware, touches):
                yield fault.inside("plants", name)


def plant_spec(arm: ArmSpec, plant: PlantSpec) -> ArmSpec:
    """Return the description of a simulated arm, without loads and changes, or raise InputError."""
    factors = [name for name in PlantSpec.model_fields if name not in _NOT_OF_ARM]
    return varied_spec(arm, **{name: getattr(plant, name) for name in factors})
