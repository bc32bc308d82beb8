"""Slow, literal models for comparison with the package; nothing here imports its physics."""
