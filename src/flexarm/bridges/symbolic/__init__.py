"""Equations of motion in CasADi and JAX, from the source of the kernels."""
