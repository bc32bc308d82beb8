"""Content of MAT files, which MATLAB and GNU Octave load."""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from typing import Any

import numpy as np

from flexarm.base.late import scipy


def mat_bytes(variables: Mapping[str, Any]) -> bytes:
    """Return the content of a MAT file of version 5.

    Vectors become columns, lists of texts cell arrays, and mappings structures. Names have at most
    63 characters.
    """
    content = BytesIO()
    plain = {name: _cells(value) for name, value in variables.items()}
    scipy.io.savemat(content, plain, oned_as="column", do_compression=True, long_field_names=True)
    return content.getvalue()


def _cells(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _cells(item) for name, item in value.items()}
    return np.array(value, dtype=object) if isinstance(value, list) else value
