"""Exported C code: its functions, its header, and its source with bodies by CasADi."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from importlib.resources import files
from itertools import chain

import casadi

from flexarm.arm.arm import Arm
from flexarm.arm.assembly.assemble import FloatArray
from flexarm.bridges.c_code.model_functions import NamedFunction
from flexarm.bridges.c_code.observer import Observer
from flexarm.bridges.c_code.stress import StressPoints, damage_texts
from flexarm.bridges.c_code.traced_law import TracedController
from flexarm.linear.models.state_space import state_names

#: Blocks of CasADi's file that this package does not use: exported names and their prefixes,
#: functions that describe functions.
_UNUSED = ("CASADI_SYMBOL_EXPORT", "CASADI_PREFIX", "CASADI_CODEGEN_PREFIX")
_SIZES = re.compile(r"^static const casadi_int (casadi_s\d+)\[.*\};\n", re.MULTILINE)
_HEAD = re.compile(r"^(static int casadi_f\d+\(.*int mem\) \{\n)", re.MULTILINE)
_HELPER = re.compile(r"^(casadi_real|casadi_int|void) (casadi_\w+\()", re.MULTILINE)
_EXPORTED = re.compile(r"int (\w+)\(const casadi_real\*\* arg[^{]*\{\s*return (casadi_f\d+)\(")


def casadi_source(functions: Sequence[casadi.Function]) -> tuple[str, dict[str, str]]:
    """Return the bodies of functions as static ones without state, and their names by function.

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
    return text + "\n", {function.name(): names[function.name()] for function in functions}


_TABLE = (files("flexarm.bridges.c_code") / "c" / "arguments.txt").read_text(encoding="utf-8")
_ARGUMENTS = [[cell.strip() for cell in row.split("|")] for row in _TABLE.splitlines()]
#: Size of an argument in terms of macros; that of others is written as a number.
EXTENTS = {name: extent for name, extent, _ in _ARGUMENTS if extent}
#: Meaning of arguments, then the unit, then the meaning of a NULL pointer.
MEANINGS = {name: meaning for name, _, meaning in _ARGUMENTS}
PLANNED = "planned input of the controller"


@dataclass(frozen=True, eq=False)
class Exported:
    """Arm of an export with its functions, and the controller and the observer with theirs."""

    name: str  # prefix of all names in C, and name of the files
    arm: Arm
    parameters: Sequence[str]  # their paths
    nominal: FloatArray  # values of the parameters in the arm
    functions: Sequence[NamedFunction]  # of the arm
    controller: TracedController | None
    observer: Observer | None
    points: StressPoints | None
    largest_step: float  # longest stable step about straight links, s

    @property
    def all_functions(self) -> list[NamedFunction]:
        """Functions of the arm, then of the controller and the observer."""
        others = [one.functions for one in (self.controller, self.observer) if one]
        return [*self.functions, *chain.from_iterable(others)]

    @property
    def sizes(self) -> dict[str, int]:
        """Sizes by the names of their macros, without the prefix."""
        macros = {"DOF": self.arm.dof, "JOINTS": self.arm.n_joints, "GAUGES": len(self.arm.gauges)}
        macros["PARAMETERS"] = len(self.parameters)
        if self.controller:
            macros["MEMORY"] = self.controller.memory
        parts = (self.observer, self.points)
        return macros | {name: size for part in parts if part for name, size in part.sizes.items()}

    def macro(self, name: str) -> str:
        """Return a macro or constant with the prefix."""
        return f"{self.name}_{name}".upper()

    def arguments(self, function: NamedFunction) -> list[str]:
        """Return the declarations of a function's arguments; ``memory`` is among the results."""
        own = function.function
        given = [
            "double step" if name == "step" else f"const {self._array(name, own.numel_in(name))}"
            for name in function.given
        ]
        outputs = {name: own.numel_out(name) for name in own.name_out()}
        written = [self._array(name.removesuffix("_out"), size) for name, size in outputs.items()]
        return given + written

    def call(self, function: NamedFunction, place: Callable[[str], str]) -> str:
        """Return a call; ``place`` returns the C expression of an argument or a result by name."""
        results = [name.removesuffix("_out") for name in function.function.name_out()]
        return f"{self.name}_{function.name}({', '.join(map(place, [*function.given, *results]))});"

    def sampled_call(
        self, functions: Sequence[NamedFunction], first: str, place: Callable[[str], str]
    ) -> list[str]:
        """Return the lines of a call of the first function if ``first`` is true, else the last."""
        *start, later = (self.call(function, place) for function in functions)
        if not start:
            return [later]
        return [f"if ({first}) {{", f"    {start[0]}", "} else {", f"    {later}", "}"]

    def _array(self, name: str, size: int) -> str:
        macros = {key: self.macro(key) for key in self.sizes}
        return f"double {name}[{EXTENTS.get(name, str(size)).format_map(macros)}]"


def prototype(name: str, arguments: Sequence[str]) -> str:
    """Return the head of a C function, over several lines if it is long."""
    line = f"void {name}({', '.join(arguments)})"
    if len(line) < 100:
        return line
    return f"void {name}(\n    " + ",\n    ".join(arguments) + ")"


def origin(file: str, title: str) -> str:
    """Return the first lines of the comment at the start of a file."""
    programs = f"flexarm {version('flexarm')} with CasADi {version('casadi')}"
    return f"/* {file}: {title}\n *\n * Generated by {programs}; do not edit.\n"


_RULES = """\
 *
 * C99. No allocation, no data that change between calls, no loop whose length depends on a value:
 * all functions may be called from several threads and from interrupts. Results must not overlap
 * arguments. Matrices are stored by rows. SI units; forces and positions in world axes.
"""


def header(export: Exported) -> str:
    """Return the text of the header."""
    guard = export.macro("H")
    title = "planar arm with flexible links"
    lines = [origin(f"{export.name}.h", title) + _RULES + _coordinates(export) + " */"]
    lines += [f"#ifndef {guard}", f"#define {guard}", "", "#ifdef __cplusplus"]
    lines += ['extern "C" {', "#endif", ""]
    lines += [f"#define {export.macro(key)} {value}" for key, value in export.sizes.items()]
    lines += ["", "/* Longest stable step about straight links, s. */"]
    lines += [f"#define {export.macro('LARGEST_STEP')} {export.largest_step!r}", ""]
    if export.parameters:
        plain = str.maketrans({"[": "_", ".": "_", "]": ""})
        places = [export.macro(path.translate(plain)) for path in export.parameters]
        commas = [*[","] * (len(places) - 1), ""]
        entries = zip(places, commas, export.parameters, strict=True)
        lines += ["/* Places of the parameters in their array. */", "enum {"]
        lines += [*(f"    {place}{comma} /* {path} */" for place, comma, path in entries), "};", ""]
        lines += ["/* Values of the parameters in the arm. */"]
        size = export.macro("PARAMETERS")
        lines += [f"extern const double {export.name}_nominal[{size}];", ""]
    lines += _declarations(export, export.functions)
    if export.points:
        rows = enumerate(export.points.names)
        lines += ["/* Points of the stress:", " *"]
        lines += [*(f" *   stress[{k}]  {text}" for k, text in rows), " */", ""]
        if export.points.detail_category is not None:
            lines.append(damage_texts(export.points, export.name)[0])
    if export.controller:
        lines += ["/* Time from one call of the controller to the next, s. */"]
        lines += [f"#define {export.macro('SAMPLE_TIME')} {export.controller.sample_time!r}", ""]
        lines += _declarations(export, export.controller.functions)
    if export.observer:
        rows = enumerate(export.observer.reading_names)
        lines += ["/* Readings of the observer:", " *"]
        lines += [*(f" *   readings[{k}]  {text}" for k, text in rows), " */", ""]
        lines += ["/* Time from one call of the observer to the next, s. */"]
        lines += [f"#define {export.macro('OBSERVER_TIME')} {export.observer.sample_time!r}", ""]
        lines += _declarations(export, export.observer.functions)
    lines += ["#ifdef __cplusplus", "}", "#endif", "", "#endif", ""]
    return "\n".join(lines)


def _coordinates(export: Exported) -> str:
    names, units = state_names(export.arm)
    rows = zip(names[: export.arm.dof], units, strict=False)
    listed = [f" *   q[{k}]  {name}, {unit}" for k, (name, unit) in enumerate(rows)]
    return "\n".join([" *", " * Coordinates, numbered from 1 by link and mode:", *listed, ""])


def _comment(export: Exported, function: NamedFunction) -> str:
    count = f" {function.operations} operations." if function.operations else ""
    outputs = [name.removesuffix("_out") for name in function.function.name_out()]
    names = [*function.given, *outputs]
    width = max(map(len, names))
    meanings = {name: MEANINGS.get(name, PLANNED) for name in names}
    rows = [f" *   {name:<{width}}  {meanings[name].format(name=export.name)}" for name in names]
    return "\n".join([f"/* {function.summary}{count}", " *", *rows, " */"])


def _declarations(export: Exported, functions: Iterable[NamedFunction]) -> Iterator[str]:
    for function in functions:
        declared = prototype(f"{export.name}_{function.name}", export.arguments(function)) + ";"
        yield from (_comment(export, function), declared, "")


def source(export: Exported) -> str:
    """Return the text of the source file."""
    text, names = casadi_source([function.function for function in export.all_functions])
    parts = [origin(f"{export.name}.c", f"see {export.name}.h") + " */"]
    parts += [f'#include "{export.name}.h"\n', text]
    if export.parameters:
        parts.append(array(f"const double {export.name}_nominal", export.nominal))
    for name, values in (export.controller.defaults if export.controller else {}).items():
        parts.append(array(f"static const double {name}_at_rest", values))
    for function in export.all_functions:
        parts.append(_wrapper(export, function, names[function.function.name()]))
    if export.points and export.points.detail_category is not None:
        parts.append(damage_texts(export.points, export.name)[1])
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
        "&step" if name == "step" else _pointer(export, function, name) for name in own.name_in()
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
    lines += [
        f"    const double *arg[{own.sz_arg()}] = {{{', '.join(given)}}};",
        f"    double *res[{own.sz_res()}] = {{{', '.join(written)}}};",
    ]
    if own.sz_iw():
        lines.append(f"    int iw[{own.sz_iw()}];")
    if own.sz_w():
        lines.append(f"    double w[{own.sz_w()}];")
    scratch = ("iw" if own.sz_iw() else "0", "w" if own.sz_w() else "0")
    lines.append(f"    (void){body}(arg, res, {', '.join(scratch)}, 0);")
    if memory:
        lines.append(f"    for (k = 0; k < {export.macro(memory)}; ++k) {{")
        lines += [f"        {memory}[k] = memory_next[k];", "    }"]
    return "\n".join([*lines, "}", ""])


def _pointer(export: Exported, function: NamedFunction, name: str) -> str:
    """Return the pointer to an input."""
    if name not in function.inputs:
        return "0"
    if name == "parameters":
        return f"parameters ? parameters : {export.name}_nominal"
    if export.controller and name in export.controller.defaults:
        return f"{name} ? {name} : {name}_at_rest"
    return name
