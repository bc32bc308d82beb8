"""The recursion over the bodies: forward and inverse dynamics, mass matrix."""
