"""Private names of Numba that the package uses, each with a fallback; no other file imports them.

| name | use | without it |
| --- | --- | --- |
| ``event`` | time of compilation | no message about it |
| ``CompileResult``, ``dumps`` | machine code on disk | every process compiles |
| ``BaseContext``, ``BaseFunction``, ``Compiler``, ``JITCodeLibrary`` | machine code once, see
  `code_library` | Numba links a kernel into each of its callers |
| ``Conversion``, ``AbstractTemplate``, ``infer_global`` | packs and dual numbers | batches execute
  run by run, and runs have no derivatives |
| ``cpu_target`` | a library of kernels, functions that kernels refer to | kernels compile one by
  one; packs and dual numbers do not |
| ``CPUTargetOptions`` | kernels without reference counting | slower kernels |

Other files use what is documented for authors of extensions: ``numba.extending``,
``numba.types``, ``numba.config`` and ``numba.core.cgutils``.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from numba import types


def _private(module: str, name: str, instead: Any = None) -> Any:
    """Return a name of a module of ``numba.core``; ``instead`` if this version does not have it."""
    try:
        return getattr(import_module(f"numba.core.{module}"), name)
    except (ImportError, AttributeError):
        return instead


Listener = _private("event", "Listener", object)
_register = _private("event", "register")
BaseContext = _private("base", "BaseContext")
BaseFunction = _private("types.functions", "BaseFunction")
Compiler = _private("compiler", "Compiler")
JITCodeLibrary = _private("codegen", "JITCodeLibrary")
Conversion = _private("typeconv.castgraph", "Conversion")
AbstractTemplate = _private("typing.templates", "AbstractTemplate")
infer_global = _private("typing.templates", "infer_global")
if infer_global is None:
    _registry = _private("typing.templates", "builtin_registry")
    infer_global = getattr(_registry, "register_global", None)
CompileResult = _private("compiler", "CompileResult")
dumps = _private("serialize", "dumps")
CPUTargetOptions = _private("cpu", "CPUTargetOptions")
cpu_target = _private("registry", "cpu_target")

#: Whether packs and dual numbers can be types of numbers in kernels.
HAS_NUMBER_TYPES = None not in (Conversion, AbstractTemplate, infer_global)
#: Whether machine code can be written to files.
CAN_SAVE = dumps is not None and hasattr(CompileResult, "_reduce")
#: Whether kernels can be compiled without reference counting.
CAN_OMIT_REFERENCES = hasattr(CPUTargetOptions, "_nrt")


def _links_as_expected() -> bool:
    """Return whether this version of Numba links as `code_library` assumes."""
    try:
        linking = set(JITCodeLibrary._get_module_for_linking.__code__.co_names)
        finalizing = set(JITCodeLibrary.finalize.__code__.co_names)
        arguments = BaseFunction.get_call_type.__code__.co_argcount
    except AttributeError:
        return False
    steps = {"_get_module_for_linking", "_optimize_final_module", "_finalize_final_module"}
    return (
        {"_shared_module", "_final_module"} <= linking
        and steps <= finalizing
        and hasattr(BaseContext, "declare_env_global")
        and arguments == 4
    )


#: Whether machine code of a kernel can exist once, and not once for each of its callers.
CAN_LINK = _links_as_expected()


def serialized(key: Any, references: Any, version: Any) -> bytes:
    """Return the machine code of a compiled version of a kernel, with its key and references."""
    content: bytes = dumps((key, references, version._reduce()))
    return content


def rebuilt(context: Any, code: Any) -> Any:
    """Return the compiled version of a kernel from the code in `serialized`."""
    return CompileResult._rebuild(context, *code)


def register_listener(listener: Any) -> None:
    """Report every compilation to a `Listener`."""
    if _register is not None:
        _register("numba:compile", listener)


def declare(function: Any, count: int, number: Any, others: Any, result: Any) -> None:
    """Let the compiler know a function of ``count`` numbers of a new type.

    Args:
        number: the new type; at least one argument has it.
        others: classes of the types of the other arguments.
        result: type of the result.
    """
    if not HAS_NUMBER_TYPES:
        return

    class Rule(AbstractTemplate):  # type: ignore[misc,valid-type]
        key = function

        def generic(self, args: Any, keywords: Any) -> Any:
            fits = len(args) == count and number in args and not keywords
            if fits and all(kind == number or isinstance(kind, others) for kind in args):
                return result(*args)
            return None

    # The decorator form reads ``function.__module__``, which ufuncs have since NumPy 2.1 only.
    infer_global(function, types.Function(Rule))


def type_of_constant(value: Any) -> Any:
    """Return the type of a function for Numba that a kernel refers to."""
    return cpu_target.typing_context.resolve_value_type(value)
