"""Exact derivatives of integrator steps by state, torque and parameters."""
