"""Modes of vibration: frequencies, damping, shapes, and their tracking."""
