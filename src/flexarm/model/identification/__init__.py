"""Measured records, free parameters and studies of an identification."""
