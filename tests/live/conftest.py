from __future__ import annotations

from pathlib import Path

import pytest
from live_pages import written_pages


@pytest.fixture(scope="session")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the files of all live pages."""
    return written_pages(tmp_path_factory.mktemp("live"))
