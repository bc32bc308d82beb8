"""Controllers designed with linear models."""
