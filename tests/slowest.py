"""The slowest test files, for `conftest`."""

from __future__ import annotations

#: Files with tests of several seconds, the slowest first. They run before the others, so that no
#: worker is busy at the end with one that started late.
SLOWEST = (
    "docs/test_site.py",
    "docs/test_docs_examples.py",
    "examples/test_study_files.py",
    "oracle_comparison/test_section_forces_oracle.py",
    "unit/control/test_extended_kalman.py",
    "benchmarks/test_benchmarks_run.py",
    "cli/test_paper_command.py",
    "bridges/test_jax.py",
    "unit/kernels/test_code_library.py",
    "unit/kernels/test_kernel_cache.py",
    "unit/kernels/test_kernel_sizes.py",
    "project/test_wheel.py",
    "simulate/test_inversion.py",
    "conformance/test_every_kernel_is_warmed_up.py",
    "simulate/test_energy_and_memory.py",
    "gallery/test_gallery.py",
)
