"""Changes of the simulated arm during a run."""
