"""Torques, loads and prescribed joint angles as functions of time."""
