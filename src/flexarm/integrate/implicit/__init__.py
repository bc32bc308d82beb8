"""Implicit methods: additive Runge-Kutta, Gauss collocation, generalised-alpha."""
