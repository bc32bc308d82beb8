"""Experiments before they are made: what their records will determine."""
