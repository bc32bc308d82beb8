"""Bodies of C functions, from CasADi's code generator."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import casadi

#: Blocks of CasADi's file that this package does not use: exported names and their prefixes,
#: functions that describe functions.
_UNUSED = ("CASADI_SYMBOL_EXPORT", "CASADI_PREFIX", "CASADI_CODEGEN_PREFIX")
_SIZES = re.compile(r"^static const casadi_int (casadi_s\d+)\[.*\};\n", re.MULTILINE)
_HEAD = re.compile(r"^(static int casadi_f\d+\(.*int mem\) \{\n)", re.MULTILINE)
_HELPER = re.compile(r"^(casadi_real|casadi_int|void) (casadi_\w+\()", re.MULTILINE)
_EXPORTED = re.compile(r"int (\w+)\(const casadi_real\*\* arg[^{]*\{\s*return (casadi_f\d+)\(")


class Source(NamedTuple):
    """Static functions in C, and the name of each function among them."""

    text: str
    names: dict[str, str]


def casadi_source(functions: Sequence[casadi.Function]) -> Source:
    """Return the bodies of functions, as static functions without state.

    A function gets pointers to its inputs and outputs, and its scratch from the caller: integers
    ``iw`` and numbers ``w`` of the sizes ``sz_iw`` and ``sz_w``. It allocates nothing.
    """
    generator = casadi.CodeGenerator("code", {"with_mem": False, "casadi_int": "int"})
    for function in functions:
        generator.add(function)
    whole = generator.dump()
    names = dict(_EXPORTED.findall(whole))
    blocks = [one for one in whole.split("\n\n") if not any(word in one for word in _UNUSED)]
    text = "\n\n".join(block.strip("\n") for block in blocks if block.strip())
    used = Counter(re.findall(r"\bcasadi_s\d+", text))
    text = _SIZES.sub(lambda size: size[0] if used[size[1]] > 1 else "", text)
    # Names are private to the file, and unused arguments are no warnings.
    text = _HELPER.sub(r"static \1 \2", text)
    text = _HEAD.sub(r"\1  (void)arg; (void)res; (void)iw; (void)w; (void)mem;\n", text)
    return Source(text + "\n", {function.name(): names[function.name()] for function in functions})
