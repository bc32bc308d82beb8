"""Kernels without machine code for Python: a call from Python gives an error and no crash."""

import pytest

from flexarm.kernels.compilation.cache import compiled, inner, merged, undecorated


@inner
def double(x):
    return 2.0 * x


@merged
def triple(x):
    return 3.0 * x


@compiled
def sixfold(x):
    return double(triple(x))


@pytest.mark.compiled
@pytest.mark.parametrize("kernel", [double, triple])
def test_call_from_python_is_rejected_before_and_after_compilation(kernel):
    name = undecorated(kernel).__name__
    with pytest.raises(TypeError, match=f"{name} is compiled for other kernels alone"):
        kernel(1.0)
    assert sixfold(1.5) == 9.0
    with pytest.raises(TypeError, match=f"{name} is compiled for other kernels alone"):
        kernel(1.5)


def test_plain_function_runs():
    assert undecorated(triple)(1.5) == 4.5
    assert undecorated(double)(1.5) == 3.0
