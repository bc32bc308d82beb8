"""Cowell's method for long vibrations."""
