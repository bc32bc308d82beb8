"""Estimation of states and payloads from readings."""
