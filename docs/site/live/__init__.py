"""Pages in which the compiled kernels simulate arms: their memory, kernels and files."""
