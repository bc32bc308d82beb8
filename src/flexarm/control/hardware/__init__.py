"""Instruments, motors and measurements between a controller and an arm."""
