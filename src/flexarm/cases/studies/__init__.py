"""Studies with samples: their runs on several processes, their store and their statistics."""
