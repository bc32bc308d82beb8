"""Plants and controllers against the clock, in one process or over UDP."""
