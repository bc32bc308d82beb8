"""`flexarm studio`: an arm, its drive and its run in a browser; imported by that command only."""
