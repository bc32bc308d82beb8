"""Slow, literal models that the package is compared with; nothing here imports its physics."""
