"""Exact derivatives of the kernels."""
