"""Linear models and statics: equilibrium, modes of vibration, state space."""

from flexarm.arm.closed import AssembledState, assembled
from flexarm.linear.models.linearize import linearize
from flexarm.linear.models.state_space import LinearModel
from flexarm.linear.statics.equilibrium import Equilibrium, EquilibriumError, equilibrium
from flexarm.linear.vibration.modal import Modes, modes
from flexarm.linear.vibration.tracking import ModeTracks, campbell, track_modes
from flexarm.model import Sensor

__all__ = [
    "AssembledState",
    "Equilibrium",
    "EquilibriumError",
    "LinearModel",
    "ModeTracks",
    "Modes",
    "Sensor",
    "assembled",
    "campbell",
    "equilibrium",
    "linearize",
    "modes",
    "track_modes",
]
