"""Carry a run through time: integrator, step, events, contacts, channels."""
