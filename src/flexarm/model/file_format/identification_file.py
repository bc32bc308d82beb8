"""Files that describe an identification."""

from __future__ import annotations

from collections.abc import Callable

from flexarm.base.writing.places import AnyPath
from flexarm.model.file_format.files import _located
from flexarm.model.file_format.yaml_text import Document
from flexarm.model.identification.study import IdentificationStudy
from flexarm.model.wording import Path


def locate_identification(
    path: AnyPath | Document,
) -> tuple[IdentificationStudy, Callable[[Path], str]]:
    """Read the file of an identification; return it with a function from key path to line.

    Raises:
        ModelError: if the file or its arm file is invalid; lists all problems with lines.
    """
    return _located(IdentificationStudy, path)
