"""Prediction errors: extended Kalman filters along measured records, and the fit of their gains."""
