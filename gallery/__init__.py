"""The validation gallery: what the package computes beside what is known, digit by digit."""
