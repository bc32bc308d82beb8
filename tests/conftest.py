"""Settings of the whole suite. This file also puts ``tests/`` on the import path."""

import os
from pathlib import Path

# Set before NumPy loads: the matrices are small, and threads would compete with the workers of
# pytest.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Plots open no windows.
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest
from hypothesis import settings

from flexarm.kernels.compilation.cache import INTERPRETED
from slowest import SLOWEST

# The first example of a test may compile a kernel for seconds, so there is no deadline. Examples
# are the same in every run, so that results do not depend on chance; `make suite SEED=7` draws
# others.
settings.register_profile("flexarm", deadline=None, derandomize=True)
settings.register_profile("random", deadline=None)
settings.load_profile("flexarm")

_RANKS = {Path(__file__).parent / file: rank for rank, file in enumerate(SLOWEST)}


def pytest_configure(config: pytest.Config) -> None:
    """With NUMBA_DISABLE_JIT=1, let kernels compute infinities without warnings, as compiled ones
    do."""
    if INTERPRETED:
        for event in ("overflow", "invalid value", "divide by zero"):
            config.addinivalue_line("filterwarnings", f"ignore:{event}:RuntimeWarning")


def _is_thorough_case(item: pytest.Item) -> bool:
    """Return whether ``thorough_cases`` or ``sampled`` leaves this test to `make test-all`."""
    names = {item.name.partition("[")[0]}
    if hasattr(item, "callspec"):
        names |= {item.callspec.id, *item.callspec.id.split("-")}
    left_out, sample = item.get_closest_marker("thorough_cases"), item.get_closest_marker("sampled")
    return bool(left_out and names & set(left_out.args)) or bool(
        sample and not names & set(sample.args)
    )


@pytest.hookimpl(tryfirst=True)  # before -m selects by markers
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Give thorough cases their marker, and move the slowest files to the front; other files, and
    tests within a file, keep their order."""
    for item in filter(_is_thorough_case, items):
        item.add_marker(pytest.mark.thorough)
    items.sort(key=lambda item: _RANKS.get(item.path, len(_RANKS)))
    if INTERPRETED:
        for item in items:
            if item.get_closest_marker("compiled"):
                item.add_marker(pytest.mark.skip(reason="about compiled kernels, or too long"))
