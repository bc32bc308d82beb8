"""Terms that controllers evaluate at each sample time."""
