"""Steppers for eight runs at once, one in each lane of a vector: explicit and additive methods."""
