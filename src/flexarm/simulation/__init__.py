"""Runs through time: one run, its loop, many at once, their derivatives, real time."""
