"""Statics: equilibrium, steady rotation, and the matrices of small motion."""
