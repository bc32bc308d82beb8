"""Description of an identification: an arm, measured records and free parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from flexarm.base.writing.places import AnyPath
from flexarm.model.arm.spec import ArmSpec
from flexarm.model.checks import Given, Record
from flexarm.model.file_format.files import _located
from flexarm.model.file_format.yaml_text import Document
from flexarm.model.hardware import Motors, Seed
from flexarm.model.identification.parameters import FreeParameter
from flexarm.model.identification.records import RecordFile
from flexarm.model.quantities import (
    Count,
    Listed,
    Mapped,
    Named,
    NonNegative,
    OneOrMany,
    Positive,
    Word,
)
from flexarm.model.wording import Fault, Path


class FitSettings(Record):
    """Settings of the least-squares fit and of its runs."""

    starts: Count = 1
    """Number of starts; all but the first are drawn at random."""
    seed: Seed = 0
    """Seed of the random starts."""
    loss: Literal["linear", "soft_l1", "huber", "cauchy"] = "linear"
    """Loss of a residual; all but linear are robust to outliers."""
    method: Literal["output_error", "prediction_error"] = "output_error"
    """Errors that are fitted: those of the simulated channels, or of the predictions of an extended
    Kalman filter, which disturbance torques bias less."""
    torque_noise: OneOrMany[NonNegative] | None = None
    """Standard deviation of a random torque error in each sample, one for all joints or one for
    each, for prediction_error (N m); estimated by default."""
    iterations: Count = 200
    """Most evaluations of the residuals of a fit from one start."""
    integrator: Word = "auto"
    """Name of the integrator."""
    step: Positive | None = None
    """Fixed step of the integrator (s)."""
    rtol: Positive = 1e-7
    """Relative tolerance of a step."""
    atol: Positive | None = None
    """Absolute tolerance at the tip (m); by default rtol / 100 of the reach."""


def _parameter(value: Any) -> Any:
    """Convert the path of a parameter to the mapping that it stands for."""
    return {"path": value} if isinstance(value, str) else value


class IdentificationStudy(Record):
    """Estimation of parameters of an arm from measured records."""

    arm: ArmSpec
    """The arm with the values from which the estimation starts."""
    motors: Motors | None = None
    """Motors, for records with currents as inputs."""
    records: Named[RecordFile]
    """Records that are fitted, by name."""
    validation: Mapped[RecordFile] = Field(default={}, validate_default=True)
    """Records that are predicted with the estimates and not fitted, by name."""
    free: Listed[Annotated[FreeParameter, BeforeValidator(_parameter)]]
    """Parameters to estimate: their paths, or mappings with a path."""
    fit: FitSettings = FitSettings()
    """Settings of the fit."""

    @classmethod
    def _faults(cls, given: Given) -> Iterator[Fault]:
        if given.has("free") and not given.free:
            yield Fault(("free",), "has no entry")
        if given.has("records", "validation"):
            for name in given.validation:
                if name in given.records:
                    yield Fault(("validation", name), "repeats the name of a fitted record")


def locate_identification(
    path: AnyPath | Document,
) -> tuple[IdentificationStudy, Callable[[Path], str]]:
    """Read the file of an identification; return it with a function from key path to line.

    Raises:
        ModelError: if the file or its arm file is invalid; lists all problems with lines.
    """
    return _located(IdentificationStudy, path)
