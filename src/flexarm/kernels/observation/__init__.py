"""Observables of a state: poses, energies, shapes, section forces, motion of points."""
