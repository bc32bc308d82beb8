"""Torques, loads and prescribed angles as functions of time."""
