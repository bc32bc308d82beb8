"""Simulation of an arm: ``simulate`` and related functions, results, metrics, comparisons."""
