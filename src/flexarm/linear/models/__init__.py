"""Linear state-space models with named inputs and outputs."""
