"""Linear models: modes of vibration."""

from flexarm.linear.modal import Modes, modes

__all__ = ["Modes", "modes"]
