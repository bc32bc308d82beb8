"""Planned experiments: identifiability of parameters."""
