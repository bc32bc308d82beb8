"""Dynamics along a motion: rigid torques, inverse dynamics, tip constraints."""
