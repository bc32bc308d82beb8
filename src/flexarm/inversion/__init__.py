"""Torques and references for which the tip or the joints of a flexible arm follow a motion."""
