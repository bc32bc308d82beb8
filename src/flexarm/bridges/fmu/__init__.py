"""Functional mock-up units: the exported C code behind the functions of FMI."""
