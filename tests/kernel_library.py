"""The library of kernels of this environment, for tests about it."""

import os
import shutil

import pytest

from flexarm.kernels.compilation import library


def built_library() -> library.Library:
    """Return the library; without a C compiler `flexarm warmup` builds none, and the test skips."""
    known = library.loaded()
    if known is None and shutil.which(os.environ.get("CC", "cc")) is None:
        pytest.skip("no C compiler: there is no library of kernels")
    assert known is not None, f"flexarm warmup builds the library: {library.reason()}"
    return known
