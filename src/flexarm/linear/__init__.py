"""Linear models and statics: equilibrium, modes of vibration, state space."""

from flexarm.linear.equilibrium import Equilibrium, EquilibriumError, equilibrium
from flexarm.linear.linearize import linearize
from flexarm.linear.modal import Modes, modes
from flexarm.linear.signals import Sensor
from flexarm.linear.state_space import LinearModel

__all__ = [
    "Equilibrium",
    "EquilibriumError",
    "LinearModel",
    "Modes",
    "Sensor",
    "equilibrium",
    "linearize",
    "modes",
]
