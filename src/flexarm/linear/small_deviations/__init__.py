"""Small deviations from a motion, linearised along it."""
