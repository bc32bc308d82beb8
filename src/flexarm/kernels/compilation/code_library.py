"""Generate the machine code of a kernel once, and not once for each of its callers.

Numba links the code of every kernel into all kernels that call it, and optimizes and translates it
there again, with all kernels that it calls in turn; see decision 0021. Here there are two kinds of
kernels besides Numba's own:

- A *merged* kernel has no machine code of its own, because its callers contain it.
- A kernel *apart* is not linked: callers refer to the symbol of its machine code. When a caller is
  loaded from disk, the kernels to which it refers are loaded before it.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from numba import config

from flexarm.kernels.compilation.fused import fuse
from flexarm.kernels.compilation.numba_internals import BaseFunction, Compiler, JITCodeLibrary

#: Modules of the operators and functions whose signatures depend on the types alone.
_BUILT_IN = {"_operator", "builtins", "math"}
#: Signatures that kernels have used, by function and types of the arguments.
_signatures: dict[tuple[Any, ...], Any] = {}
_config: Any = config
_resolve = BaseFunction.get_call_type


def _remembered(self: Any, context: Any, types: Any, keywords: Any) -> Any:
    """Return the signature of a call; that of an operator is resolved once for all kernels."""
    if keywords or getattr(self.typing_key, "__module__", "") not in _BUILT_IN:
        return _resolve(self, context, types, keywords)
    key = (self.typing_key, len(self.templates), *types)
    if key not in _signatures:
        _signatures[key] = _resolve(self, context, types, keywords)
    return _signatures[key]


#: What a compilation has replaced: a function, the state of the garbage collection, and the two
#: switches of vectorization; None between compilations.
_replaced: tuple[Any, bool, tuple[Any, Any]] | None = None


def _accelerate() -> None:
    """Set the compiler up for kernels: fused sums, no vectorization, no search for garbage."""
    global _replaced
    vectorize = _config.LOOP_VECTORIZE, _config.SLP_VECTORIZE
    _replaced = BaseFunction.get_call_type, gc.isenabled(), vectorize
    BaseFunction.get_call_type = _remembered
    _config.LOOP_VECTORIZE = _config.SLP_VECTORIZE = 0
    gc.disable()
    fuse(True)


def _restore() -> None:
    """Undo `_accelerate`, if it has been called.

    Also in the child of a fork: if another thread was compiling, it does not exist in the child.
    """
    global _replaced
    if _replaced is None:
        return
    BaseFunction.get_call_type, collecting, vectorize = _replaced
    _config.LOOP_VECTORIZE, _config.SLP_VECTORIZE = vectorize
    if collecting:
        gc.enable()
    fuse(False)
    _replaced = None


if hasattr(os, "register_at_fork"):  # absent on Windows
    os.register_at_fork(after_in_child=_restore)


class KernelCompiler(Compiler):  # type: ignore[misc]
    """Numba's compiler with a memory for the signatures of operators, and without vectorization.

    Numba would otherwise try up to ten candidates for each sum and each product, twice. Python's
    search for cyclic garbage waits for the end, because it takes a tenth of the time. Loops over
    bodies and modes are too short for vector instructions, whose preparation costs a fifth of the
    forward dynamics if the compiler does not know the sizes.
    """

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile a function; the caller holds the lock of the compiler."""
        if _replaced is not None:  # compilation of a kernel that calls this one
            return super().compile_extra(function)
        try:
            _accelerate()
            return super().compile_extra(function)
        finally:
            _restore()


class MergedCompiler(KernelCompiler):
    """Compiler of kernels that have no machine code of their own."""

    def compile_extra(self, function: Callable[..., Any]) -> Any:
        """Compile a function; the caller holds the lock of the compiler."""
        context = self.state.targetctx
        new_library: Any = _MergedLibrary
        self.state.library = new_library(context.codegen(), function.__qualname__)
        self.state.library.context = context
        self.state.library.enable_object_caching()
        return super().compile_extra(function)


class _MergedLibrary(JITCodeLibrary):  # type: ignore[misc]
    """Code of a merged kernel; only Numba's variables for the kernel become machine code."""

    context: Any
    _final_module: Any

    def _optimize_final_module(self) -> None:
        """Do nothing, because this code is optimized together with the code of its callers."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()  # a caller's code would contain their addresses
        code = self._final_module
        for function in code.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        codegen: Any = self._codegen
        variables = codegen._create_empty_module(self.name)
        for variable in code.global_variables:
            if variable.name.startswith("_ZN08NumbaEnv"):
                self.context.declare_env_global(variables, variable.name)
        self._shared_module, self._final_module = code, llvm.parse_assembly(str(variables))
        self._final_module.name = code.name
        super()._finalize_final_module()


class Reference(NamedTuple):
    """A kernel apart to which machine code refers by a symbol."""

    symbol: str
    module: str
    name: str
    signature: Any


#: Variable in the code of all callers of kernels apart. Because of its name, Numba's own cache does
#: not save a user's function that calls one: it would load the function without the kernel.
_MARK = "numba.dynamic.globals.flexarm"
#: Kernels apart by the symbols to which the code of this process may refer.
_apart: dict[str, Reference] = {}


def references(version: Any, module: Any = None) -> list[Reference]:
    """Return the kernels apart to which a compiled version of a kernel, or its code, refers."""
    code = module or version.library._get_module_for_linking()
    return [_apart[f.name] for f in code.functions if f.is_declaration and f.name in _apart]


def module_of(version: Any) -> Any:
    """Return a copy of the code of a version that this process compiled, in LLVM's language."""
    return version.library._final_module.clone()


def has_addresses(version: Any) -> bool:
    """Return whether a compiled version contains addresses of this process."""
    return bool(set(version.library._dynamic_globals) - {_MARK})


def set_apart(function: Callable[..., Any], version: Any, symbol: str = "") -> None:
    """Make later callers refer to a compiled version of a kernel instead of linking it.

    Args:
        function: the undecorated kernel. version: its compiled version.
        symbol: the name of its machine code in the process that compiled the caller, which may
            differ from the name in this process.
    """
    library, own = version.library, version.fndesc.llvm_func_name
    address = library.get_pointer_to_function(own)
    if not address:
        return  # Numba links it
    place = function.__module__, function.__qualname__
    for one in {own, symbol or own}:
        llvm.add_symbol(one, address)
        _apart[one] = Reference(one, *place, version.signature)
    empty = library._codegen._create_empty_module(library.name)
    mark = f'@"{_MARK}" = common global i8 0'
    library._shared_module = llvm.parse_assembly(f"{empty}\n{mark}\n")


def load(needed: list[Reference]) -> None:
    """Compile or load the kernels apart to which code from disk refers.

    Raises:
        LookupError: if one of them has changed its signature, so that the code must not call it.
    """
    for one in needed:
        if one.symbol not in _apart:
            kernel = getattr(import_module(one.module), one.name).dispatcher
            kernel.compile(one.signature.args)
            set_apart(kernel.py_func, kernel.overloads[one.signature.args], one.symbol)
        if _apart[one.symbol] != one:
            raise LookupError(f"{one.name} has another signature now")
