"""An arm as arrays for the kernels: assembly, coordinates, cached calls and buffers."""
