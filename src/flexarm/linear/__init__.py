"""Linear models and statics: equilibrium, modes of vibration, state space."""

from flexarm.arm.closed import AssembledState as AssembledState
from flexarm.arm.closed import assembled as assembled
from flexarm.linear.models.linearize import linearize as linearize
from flexarm.linear.models.state_space import LinearModel as LinearModel
from flexarm.linear.statics.equilibrium import Equilibrium as Equilibrium
from flexarm.linear.statics.equilibrium import EquilibriumError as EquilibriumError
from flexarm.linear.statics.equilibrium import equilibrium as equilibrium
from flexarm.linear.vibration.modal import Modes as Modes
from flexarm.linear.vibration.modal import modes as modes
from flexarm.linear.vibration.tracking import ModeTracks as ModeTracks
from flexarm.linear.vibration.tracking import campbell as campbell
from flexarm.linear.vibration.tracking import track_modes as track_modes
from flexarm.model import Sensor as Sensor
