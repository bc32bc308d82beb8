"""Linear models and statics: equilibrium, modes of vibration, state space."""

from flexarm.linear.equilibrium import Equilibrium, EquilibriumError, equilibrium
from flexarm.linear.linearize import linearize
from flexarm.linear.modal import Modes, modes
from flexarm.linear.state_space import LinearModel
from flexarm.linear.tracking import ModeTracks, campbell, track_modes
from flexarm.model import Sensor

__all__ = [
    "Equilibrium",
    "EquilibriumError",
    "LinearModel",
    "ModeTracks",
    "Modes",
    "Sensor",
    "campbell",
    "equilibrium",
    "linearize",
    "modes",
    "track_modes",
]
