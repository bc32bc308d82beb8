"""Conversion of scenario and study files to runs."""
