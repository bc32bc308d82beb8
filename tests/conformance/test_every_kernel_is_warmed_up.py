"""The library contains every kernel that Python calls, so that nothing compiles on first use."""

import json
import pkgutil
from importlib import import_module

import pytest

import flexarm
from flexarm.kernels.compilation import library
from flexarm.kernels.compilation.cache import Kernel
from kernel_library import built_library

#: Kernels that only tests call from Python.
TESTED = {
    "flexarm.kernels.recursion.articulated_body.implicit_dynamics",
    "flexarm.kernels.recursion.implicit_step.add_to_diagonal",
}


def called_kernels():
    """Return the names of the kernels of the package that Python can call."""
    names = set()
    for wing in ("kernels", "integrate"):
        package = import_module(f"flexarm.{wing}")
        for module in pkgutil.walk_packages(package.__path__, f"flexarm.{wing}."):
            for kernel in vars(import_module(module.name)).values():
                if isinstance(kernel, Kernel) and not kernel.inside:
                    names.add(f"{kernel.__module__}.{kernel.__qualname__}")
    return names


@pytest.mark.compiled
def test_library_contains_every_kernel():
    known = built_library()
    table = json.loads((known.folder / library.TABLE).read_text(encoding="utf-8"))
    names = called_kernels()
    assert f"{flexarm.__name__}.integrate.explicit_runge_kutta.explicit.advance_explicit" in names
    assert sorted(names - TESTED - set(table["codes"])) == []
