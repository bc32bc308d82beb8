"""Fixtures of the command line tests."""

from __future__ import annotations

from pathlib import Path

import pytest
from scenarios import GOOD


@pytest.fixture
def good(tmp_path: Path) -> Path:
    """Return a valid scenario file."""
    path = tmp_path / "good.yaml"
    path.write_text(GOOD)
    return path
