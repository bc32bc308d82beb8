"""Run engine: integrator choice, step size, events, contacts and output channels."""
