"""Scenario and study files to runs."""
