"""Registry of the controllers of files; a new controller is added here."""

from __future__ import annotations

from flexarm.model.drives.force import AdmittanceDrive, HybridForceDrive, ImpedanceDrive
from flexarm.model.drives.joint import (
    ComputedTorqueDrive,
    JointPDDrive,
    JointPIDDrive,
    StrainFeedbackDrive,
)
from flexarm.model.drives.linear import CompositeDrive, LQGDrive, MPCDrive
from flexarm.model.drives.uncertain import AdaptiveDrive, RBFAdaptiveDrive, SlidingModeDrive

#: All controllers except those that contain one of these.
Alone = (
    JointPDDrive
    | JointPIDDrive
    | ComputedTorqueDrive
    | StrainFeedbackDrive
    | LQGDrive
    | MPCDrive
    | CompositeDrive
    | AdaptiveDrive
    | SlidingModeDrive
    | RBFAdaptiveDrive
    | HybridForceDrive
    | ImpedanceDrive
    | AdmittanceDrive
)
