"""Controllers of the tip and its contact force."""
