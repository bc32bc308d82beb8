"""Learning of a repeated motion from trial to trial."""
