"""Paths of the tip, and motions along them."""
