"""Sampled control loop: sensors, controller and actuators."""
