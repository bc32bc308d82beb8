"""Source file of the exported C code: bodies by CasADi, and functions with readable arguments."""

from __future__ import annotations

from collections.abc import Iterable

from flexarm.arm.assembly.assemble import FloatArray
from flexarm.bridges.c_code.casadi_source import casadi_source
from flexarm.bridges.c_code.exported import Exported, origin, prototype
from flexarm.bridges.c_code.named_function import NamedFunction


def source(export: Exported) -> str:
    """Return the text of the source file."""
    found = casadi_source([one.function for one in export.all_functions])
    parts = [origin(f"{export.name}.c", f"see {export.name}.h") + " */"]
    parts += [f'#include "{export.name}.h"\n', found.text]
    if export.parameters:
        parts.append(array(f"const double {export.name}_nominal", export.nominal))
    for name, values in (export.controller.defaults if export.controller else {}).items():
        parts.append(array(f"static const double {name}_at_rest", values))
    for function in export.all_functions:
        parts.append(_wrapper(export, function, found.names[function.function.name()]))
    return "\n".join(parts)


def array(declared: str, values: FloatArray) -> str:
    """Return a definition of an array with the shape of ``values``."""
    extents = "".join(f"[{size}]" for size in values.shape)
    return f"{declared}{extents} = {_braced(values.tolist())};\n"


def _braced(values: object) -> str:
    if not isinstance(values, list):
        return repr(values)
    if values and isinstance(values[0], list):
        return "{\n" + ",\n".join(_braced(row) for row in values) + "}"
    lines = [", ".join(map(repr, values[k : k + 4])) for k in range(0, len(values), 4)]
    return "{" + ",\n    ".join(lines) + "}"


def _wrapper(export: Exported, function: NamedFunction, body: str) -> str:
    head = prototype(f"{export.name}_{function.name}", export.arguments(function))
    own = function.function
    given = [
        "&step" if name == "step" else _given(export, function, name) for name in own.name_in()
    ]
    memory = function.memory if function.memory in function.inputs else None
    written = [
        "memory_next" if name == f"{memory}_out" else name.removesuffix("_out")
        for name in own.name_out()
    ]
    lines = [head, "{"]
    if memory:
        lines.append(f"    double memory_next[{export.macro(memory)}];")
        lines.append("    int k;")
    lines += _scratch(function, given, written)
    lines.append(f"    (void){body}(arg, res, {_iw(function)}, {_w(function)}, 0);")
    if memory:
        lines.append(f"    for (k = 0; k < {export.macro(memory)}; ++k) {{")
        lines += [f"        {memory}[k] = memory_next[k];", "    }"]
    return "\n".join([*lines, "}", ""])


def _given(export: Exported, function: NamedFunction, name: str) -> str:
    """Return the pointer to an input."""
    if name not in function.inputs:
        return "0"
    if name == "parameters":
        return f"parameters ? parameters : {export.name}_nominal"
    if export.controller and name in export.controller.defaults:
        return f"{name} ? {name} : {name}_at_rest"
    return name


def _scratch(function: NamedFunction, given: Iterable[str], written: Iterable[str]) -> list[str]:
    own = function.function
    lines = [
        f"    const double *arg[{own.sz_arg()}] = {{{', '.join(given)}}};",
        f"    double *res[{own.sz_res()}] = {{{', '.join(written)}}};",
    ]
    if own.sz_iw():
        lines.append(f"    int iw[{own.sz_iw()}];")
    if own.sz_w():
        lines.append(f"    double w[{own.sz_w()}];")
    return lines


def _iw(function: NamedFunction) -> str:
    return "iw" if function.function.sz_iw() else "0"


def _w(function: NamedFunction) -> str:
    return "w" if function.function.sz_w() else "0"
