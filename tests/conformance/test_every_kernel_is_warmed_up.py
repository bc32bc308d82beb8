"""`flexarm warmup` compiles every kernel with machine code of its own."""

import subprocess
import sys

import pytest

PROGRAM = """
import pkgutil
import sys
from importlib import import_module
from types import FunctionType

import flexarm
from flexarm.cli.features import FEATURES, compile_feature

for name in FEATURES:
    compile_feature(name)
NAMES = "kernels integrate histories engine loop simulation control_design estimation controllers"
LAYERS = tuple(f"flexarm.{name}." for name in NAMES.split())
for module in pkgutil.walk_packages(flexarm.__path__, "flexarm."):
    if module.name.startswith(LAYERS):
        import_module(module.name)
kernels = [
    kernel
    for name, module in sorted(sys.modules.items())
    for kernel in (vars(module).values() if name.startswith(LAYERS) else ())
    if hasattr(kernel, "overloads") and kernel.__module__ == name
]
ready = set()


def reach(kernel):
    # A kernel that comes from disk brings those with it that it calls, also by functions such as
    # `combine`, which have other code for arrays of numbers.
    if kernel not in ready:
        ready.add(kernel)
        function = getattr(kernel, "py_func", kernel)
        for name in function.__code__.co_names:
            called = function.__globals__.get(name)
            plain = isinstance(called, FunctionType) and called.__module__.startswith(LAYERS)
            if plain or hasattr(called, "overloads"):
                reach(called)


for kernel in kernels:
    if kernel.overloads:
        reach(kernel)
for kernel in kernels:
    print(f"{kernel.__module__}.{kernel.__name__}", kernel in ready)
"""


@pytest.mark.thorough
def test_every_kernel_is_warmed_up():
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    ready = dict(line.split() for line in done.stdout.splitlines())
    assert "flexarm.integrate.explicit_runge_kutta.explicit.advance_explicit" in ready
    assert [name for name, there in ready.items() if there != "True"] == []
