"""Linear models and statics: equilibrium, modes of vibration."""

from flexarm.linear.equilibrium import Equilibrium, EquilibriumError, equilibrium
from flexarm.linear.modal import Modes, modes

__all__ = ["Equilibrium", "EquilibriumError", "Modes", "equilibrium", "modes"]
