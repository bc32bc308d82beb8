"""How fast flexarm is: `make bench` measures and writes docs/performance.

Every number is the median of repeats taken in one process; what is compared is timed in turns, so
that a slow moment of the machine hits both sides. Ratios travel between machines, times do not.
"""
