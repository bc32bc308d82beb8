"""Optimal motions: least time, energy or vibration within limits, by direct collocation."""
