"""The command line: thin commands over the same calls that Python users make."""
