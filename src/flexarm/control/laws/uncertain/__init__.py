"""Controllers for uncertain arms: adaptive, sliding-mode, disturbance observer."""
