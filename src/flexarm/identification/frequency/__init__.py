"""Frequency responses of measured records, and the modes that are fitted to them."""
