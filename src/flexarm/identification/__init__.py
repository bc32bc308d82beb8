"""Identification: measured records, and parameters of an arm that fit them."""
