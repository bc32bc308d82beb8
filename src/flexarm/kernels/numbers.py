"""The only functions beyond ``+ - * /`` that the kernels need, for every number type.

Compiled, they are the C library's for ``float64`` and ``complex128``. Undecorated, NumPy asks the
number itself (``x.sin()``), which is how symbolic scalars take part.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from flexarm.kernels.cache import merged


@merged
def sin(x: Any) -> Any:
    """Sine of a number of any type."""
    return np.sin(x)


@merged
def cos(x: Any) -> Any:
    """Cosine of a number of any type."""
    return np.cos(x)
