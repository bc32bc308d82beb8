"""Inverse dynamics of flexible arms: torques and references for a given tip or joint motion."""
