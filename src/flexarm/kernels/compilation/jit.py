"""Compile kernels with Numba; `code_cache` keeps the machine code on disk."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

import numba
from numba import types

from flexarm.kernels.compilation import library
from flexarm.kernels.compilation.cache import Kernel, declare_all
from flexarm.kernels.compilation.code_cache import cache_of, code_library
from flexarm.kernels.compilation.compile_notice import CompileNotice
from flexarm.kernels.compilation.library import Kinds
from flexarm.kernels.compilation.numba_internals import (
    CAN_OMIT_REFERENCES,
    register_listener,
    type_of_constant,
)
from flexarm.kernels.compilation.private_folder import cache_folder

#: The fast-math option that changes the sign of zeros alone. Options that change digits, such as
#: "arcp" and "contract", do so at other places in packs than in single numbers; see ``fused``.
_FAST = {"nsz"}


def _options(kernel: Kernel) -> dict[str, Any]:
    """Return the options of Numba's compiler for a kernel.

    Kernels own no memory, because their results are arguments. Without Numba's reference counting
    they run three times as fast (otherwise each array access updates an atomic counter). The option
    is undocumented, so it is omitted for versions of Numba without it.
    """
    options: dict[str, Any] = {"error_model": "numpy", "fastmath": _FAST, **kernel.options}
    if code_library:
        compiler = code_library.MergedCompiler if kernel.merged else code_library.KernelCompiler
        options["pipeline_class"] = compiler
    options["no_cfunc_wrapper"] = True  # no kernel is passed on as a C function
    options["no_cpython_wrapper"] = kernel.inside
    if CAN_OMIT_REFERENCES:
        options["_nrt"] = False
    return options


def dispatcher(kernel: Kernel) -> Any:
    """Return a kernel as a function of Numba."""
    function = kernel.py_func
    made: Any = numba.njit(**_options(kernel))(function)
    cache = cache_of(function, cache_folder(), kernel.apart)
    if cache is not None:
        made._cache = cache
    if kernel.inside:

        def keep(version: Any) -> None:
            made.overloads[tuple(version.signature.args)] = version

        made.add_overload = keep  # there is no code for calls from Python
    return made


#: Calls from Python for which this process compiled kernels, if it builds a library: kernel, types
#: as text, version.
calls: list[tuple[Kernel, str, Any]] | None = None


def code(kernel: Kernel, kinds: Kinds, arguments: tuple[Any, ...]) -> Callable[..., Any]:
    """Compile a kernel for arguments; return its code, which is called with arguments.

    The types are determined once for all arguments of these kinds, which takes 2 ms.
    """
    declare_all()
    made = kernel.dispatcher
    signature = tuple(map(made.typeof_pyval, arguments))
    made.compile(signature)
    version = made.overloads[signature]
    if calls is not None:
        with contextlib.suppress(KeyError):
            calls.append((kernel, library.signature(kinds), version))
    entry: Callable[..., Any] = version.entry_point
    return entry


def type_of(function: Any) -> Any:
    """Return the type of a kernel, or of a function of Numba, that a kernel or a user's function
    refers to."""
    declare_all()
    if isinstance(function, Kernel):
        return types.Dispatcher(function.dispatcher)
    return type_of_constant(function)


notice = CompileNotice(kept=cache_folder() is not None)
register_listener(notice)
