"""Settings of the whole suite; being here, it also puts ``tests/`` on the import path."""

import os

# One thread for linear algebra, before NumPy loads: the matrices are small, and threads would
# compete with pytest's own workers.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from hypothesis import settings

# The first example of a test may compile a kernel for seconds: no deadline can be right. In
# continuous integration the examples are always the same, elsewhere they are always new.
settings.register_profile("flexarm", deadline=None, derandomize="CI" in os.environ)
settings.load_profile("flexarm")
