"""Simulate an arm: the calls, their results, metrics and comparisons."""
