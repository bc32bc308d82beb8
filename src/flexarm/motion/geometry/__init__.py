"""Geometry of the rigid chain: forward and inverse kinematics."""
