"""External actions on an arm: loads, acceleration of its base, and contacts."""
