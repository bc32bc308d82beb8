"""Derivatives of whole runs with respect to parameters and initial states."""
