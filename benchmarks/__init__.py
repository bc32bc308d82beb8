"""Benchmarks of flexarm: `make bench` measures them and writes docs/performance.

Most numbers are medians of repeats in one process. Candidates that are compared are timed
alternately, so that a slow phase of the machine affects all of them. Ratios are comparable between
machines, times are not.
"""
