"""Registry of the controllers of files; a new controller is added here."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Annotated, Any, Union

from pydantic import Field

from flexarm.model.drives.base import ControllerDrive, ControllerParameters, drive_of
from flexarm.model.drives.force import (
    AdaptiveForceParameters,
    AdmittanceParameters,
    HybridForceParameters,
    ImpedanceParameters,
    NeuralForceParameters,
)
from flexarm.model.drives.joint import (
    ComputedTorqueKeys,
    JointPDKeys,
    JointPIDKeys,
    StrainFeedbackKeys,
)
from flexarm.model.drives.linear import (
    CompositeParameters,
    LoopShapingKeys,
    LQGParameters,
    MPCParameters,
    MuSynthesisKeys,
    NonlinearMPCParameters,
)
from flexarm.model.drives.uncertain import (
    AdaptiveParameters,
    PrescribedPerformanceKeys,
    RBFAdaptiveParameters,
    SlidingModeParameters,
)

_DECLARED: dict[str, tuple[type[ControllerParameters], ...]] = {
    "joint control": (JointPDKeys, JointPIDKeys, ComputedTorqueKeys, StrainFeedbackKeys),
    "linear models of the flexible arm": (
        LQGParameters,
        MPCParameters,
        NonlinearMPCParameters,
        CompositeParameters,
        LoopShapingKeys,
        MuSynthesisKeys,
    ),
    "uncertain arms": (
        AdaptiveParameters,
        SlidingModeParameters,
        RBFAdaptiveParameters,
        PrescribedPerformanceKeys,
    ),
    "tip position and contact force": (
        HybridForceParameters,
        ImpedanceParameters,
        AdmittanceParameters,
        AdaptiveForceParameters,
        NeuralForceParameters,
    ),
}
#: Controllers except those that contain another one, by the title of their group in lists.
GROUPS: dict[str, tuple[type[ControllerDrive], ...]] = {
    title: tuple(map(drive_of, declared)) for title, declared in _DECLARED.items()
}
ALONE: tuple[type[ControllerDrive], ...] = tuple(chain(*GROUPS.values()))


def one_of(records: Sequence[type]) -> Any:
    """Return the type of a value that is one of several records, distinguished by ``kind``."""
    return Annotated[Union[tuple(records)], Field(discriminator="kind")]  # noqa: UP007
