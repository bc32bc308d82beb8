"""Models and methods for the design of controllers: linear design, postures, shapers."""
