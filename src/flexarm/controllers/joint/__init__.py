"""Joint controllers."""
