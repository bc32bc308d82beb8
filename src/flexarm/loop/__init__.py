"""The sampled loop: sensors, controller, actuators."""
