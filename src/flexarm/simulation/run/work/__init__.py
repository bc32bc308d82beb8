"""Work of a run: its estimate, the integrator that follows from it, and open-loop runs."""
