"""Compilation of kernels: decorators, number types, machine code on disk."""
