"""Many runs at once: ``simulate_batch``, its reductions and its dataset."""
