"""Registry of the controllers of files; a new controller is added here."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Union

from pydantic import Field

from flexarm.model.drives.base import ControllerDrive, drive_of
from flexarm.model.drives.force import (
    AdmittanceParameters,
    HybridForceParameters,
    ImpedanceParameters,
)
from flexarm.model.drives.joint import (
    ComputedTorqueKeys,
    JointPDKeys,
    JointPIDKeys,
    StrainFeedbackKeys,
)
from flexarm.model.drives.linear import CompositeParameters, LQGParameters, MPCParameters
from flexarm.model.drives.uncertain import (
    AdaptiveParameters,
    RBFAdaptiveParameters,
    SlidingModeParameters,
)

#: All controllers except those that contain one of these.
ALONE: tuple[type[ControllerDrive], ...] = tuple(
    drive_of(keys)
    for keys in (
        JointPDKeys,
        JointPIDKeys,
        ComputedTorqueKeys,
        StrainFeedbackKeys,
        LQGParameters,
        MPCParameters,
        CompositeParameters,
        AdaptiveParameters,
        SlidingModeParameters,
        RBFAdaptiveParameters,
        HybridForceParameters,
        ImpedanceParameters,
        AdmittanceParameters,
    )
)


def one_of(records: Sequence[type]) -> Any:
    """Return the type of a value that is one of several records, distinguished by ``kind``."""
    return Annotated[Union[tuple(records)], Field(discriminator="kind")]  # noqa: UP007
