"""Build the library of kernels from what Numba compiled in this process; see `library`.

Every kernel becomes one object file for each level of the processor, named by its source and the
types of its arguments, so that processes can share the work. The compiler of the system links them
with the entry points: functions of one block of words, which Python calls by ``ctypes``.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm
from llvmlite import ir
from numba import types
from numba.core import cgutils

from flexarm.base.errors import InputError, Problem
from flexarm.base.writing.replace_file import replace_file
from flexarm.kernels.compilation import code_library, jit
from flexarm.kernels.compilation.code_cache import CodeCache
from flexarm.kernels.compilation.library import INTERFACE, TABLE, system
from flexarm.kernels.compilation.numba_internals import cpu_target
from flexarm.kernels.compilation.number_types import BlocksType
from flexarm.kernels.compilation.private_folder import cache_folder, sources


class Level(NamedTuple):
    """Processors that share machine code; the first level of a family that fits is used."""

    name: str
    least: int  # what `flexarm_processor` returns at least
    processor: str  # LLVM's name
    features: tuple[str, ...]  # LLVM's names
    options: str = ""  # of LLVM's code generator


_AVX_512 = ("avx2", "bmi2", "fma", "avx512bw", "avx512cd", "avx512dq", "avx512f", "avx512vl")
LEVELS = {
    "x86_64": (
        # For packs: one instruction for eight numbers, where v3 needs two.
        Level("v4", 4, "x86-64-v4", _AVX_512, "-prefer-256-bit"),
        Level("v3", 3, "x86-64-v3", ("avx2", "bmi2", "fma")),
        Level("v1", 1, "x86-64", ()),
    ),
    "aarch64": (Level("v8", 1, "generic", ()),),
    "arm64": (Level("v8", 1, "generic", ()),),
}


def levels(every: bool) -> list[Level]:
    """Return the levels of this family of processors; the one of this processor unless ``every``.

    Raises:
        InputError: for another family.
    """
    family = LEVELS.get(platform.machine().lower())
    if family is None:
        rule = f"is built for {', '.join(LEVELS)}"
        raise InputError(Problem("the library of kernels", rule, platform.machine()))
    here = llvm.get_host_cpu_features()
    fitting = [level for level in family if all(here.get(name) for name in level.features)]
    return list(family) if every else fitting[:1]


_INT, _DOUBLE = ir.IntType(64), ir.DoubleType()
_RESULTS = {types.none: "", types.float64: "d", types.int64: "q", types.boolean: "?"}
_PROCESSOR = """
#if defined(__x86_64__)
int flexarm_processor(void) {
  __builtin_cpu_init();
  int fused = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")
    && __builtin_cpu_supports("bmi2");
  int wide = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw")
    && __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq")
    && __builtin_cpu_supports("avx512vl");
  return fused ? (wide ? 4 : 3) : 1;
}
#else
int flexarm_processor(void) { return 1; }
#endif
"""


class Call(NamedTuple):
    """A call from Python: the kernel and its compiled version, by the text of its arguments."""

    kernel: Any
    text: str
    version: Any


def _symbol(module: str, name: str, signature: Any) -> str:
    """Return the name of a kernel's code, the same in every process."""
    key = f"{module}.{name}{signature}".encode()
    return f"flexarm_{name}_{hashlib.sha256(key).hexdigest()[:12]}"


def _symbol_of(function: Any, version: Any) -> str:
    return _symbol(function.__module__, function.__qualname__, version.signature)


def _standalone(function: Any, version: Any) -> Any:
    """Return a compiled kernel in LLVM's language, without Numba's entry points for Python."""
    module = code_library.module_of(version)
    others = code_library.references(version, module)
    names = {reference.symbol: _symbol(*reference[1:]) for reference in others}
    names[version.fndesc.llvm_func_name] = _symbol_of(function, version)
    for function in module.functions:
        if function.name in names:
            name = names[function.name]
            function.name, function.visibility = name, "hidden"
            if function.name != name:
                raise RuntimeError(f"{name} has two symbols")
        elif function.name.startswith(("_ZN7cpython", "cfunc.")):
            function.linkage = "available_externally"  # not in the object file
        elif not function.is_declaration:
            function.linkage = "private"
    for variable in module.global_variables:
        if not variable.is_declaration:
            variable.linkage = "internal"
    return module


def _argument(builder: Any, kind: Any, block: Any, place: list[int]) -> Any:
    """Return a value of a type of Numba from the words of a block, from ``place`` on."""
    context = cpu_target.target_context
    if isinstance(kind, types.BaseTuple):
        parts: Any = kind
        values = [_argument(builder, part, block, place) for part in parts]
        return context.make_tuple(builder, kind, values)
    if isinstance(kind, BlocksType):
        blocks = cgutils.create_struct_proxy(kind)(context, builder)
        blocks.array = _argument(builder, kind.array, block, place)
        return blocks._getvalue()
    at = builder.gep(block, [_INT(place[0])])
    place[0] += 1
    if isinstance(kind, types.Array):
        return _array(builder, kind, builder.load(at), builder.load(block))
    if kind == types.float64:
        return builder.load(builder.bitcast(at, _DOUBLE.as_pointer()))
    if kind == types.boolean:
        return builder.icmp_signed("!=", builder.load(at), _INT(0))
    return builder.load(at)


def _array(builder: Any, kind: Any, thing: Any, head: Any) -> Any:
    """Return an array of Numba from the address of NumPy's object, whose fields follow ``head``."""
    context = cpu_target.target_context
    place = builder.inttoptr(builder.add(thing, head), _INT.as_pointer())
    data, _, *sizes = (builder.load(builder.gep(place, [_INT(k)])) for k in range(4))
    lengths = [
        [builder.load(builder.gep(builder.inttoptr(start, _INT.as_pointer()), [_INT(k)]))
         for k in range(kind.ndim)]
        for start in sizes
    ]  # fmt: skip
    array = context.make_array(kind)(context, builder)
    array.data = builder.inttoptr(data, array.data.type)
    for name, numbers in zip(("shape", "strides"), lengths, strict=True):
        setattr(array, name, cgutils.pack_array(builder, numbers, _INT))
    count = _INT(1)
    for length in lengths[0]:
        count = builder.mul(count, length)
    array.nitems = count
    array.itemsize = _INT(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    for name in ("meminfo", "parent"):
        setattr(array, name, cgutils.get_null_value(getattr(array, name).type))
    return array._getvalue()


def _entry(call: Call) -> Any:
    """Return a module with the entry point of a call: a function of a block of words.

    It returns 0, or 1 if the kernel raised an exception; then the word of the result, if any.
    """
    context, version = cpu_target.target_context, call.version
    symbol = _symbol_of(call.kernel.py_func, version)
    returned, kinds = version.signature.return_type, version.signature.args
    result = _INT if returned == types.none else ir.LiteralStructType([_INT, _INT])
    module = ir.Module(f"entry_{symbol}")
    function = ir.Function(module, ir.FunctionType(result, [_INT.as_pointer()]), f"entry_{symbol}")
    builder = ir.IRBuilder(function.append_basic_block())
    place = [1]  # behind the size of an object's head
    values = [_argument(builder, kind, function.args[0], place) for kind in kinds]
    convention = context.call_conv.get_function_type(returned, kinds)
    callee = ir.Function(module, convention, symbol)
    status, value = context.call_conv.call_function(builder, callee, returned, kinds, values)
    failed = builder.zext(status.is_error, _INT)
    if returned == types.none:
        builder.ret(failed)
    else:
        word = builder.bitcast(value, _INT) if returned == types.float64 else value
        word = builder.zext(value, _INT) if returned == types.boolean else word
        builder.ret(
            builder.insert_value(builder.insert_value(result(ir.Undefined), failed, 0), word, 1)
        )
    return llvm.parse_assembly(str(module))


def record(folder: Path) -> None:
    """Keep what this process compiles from now on, for `export`.

    Its cache is its own: code of another process refers to a kernel by another symbol, and code
    that contains both symbols could not be linked.
    """
    os.environ["FLEXARM_CACHE"] = str(folder / f"cache-{os.getpid()}")
    cache_folder.cache_clear()
    CodeCache.compiled, jit.calls = CodeCache.compiled or [], jit.calls or []


def export(folder: Path, every: bool = False) -> None:
    """Write object files of all kernels that this process compiled, and of their calls."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    while CodeCache.compiled:
        function, version = CodeCache.compiled.pop()
        _emit(_symbol_of(function, version), partial(_standalone, function, version), folder, every)
    while jit.calls:
        call = Call(*jit.calls.pop())
        returned = call.version.signature.return_type
        symbol = f"entry_{_symbol_of(call.kernel.py_func, call.version)}"
        _emit(symbol, partial(_entry, call), folder, every)
        name = f"{call.kernel.__module__}.{call.kernel.__qualname__}"
        held = not call.kernel.options.get("nogil")
        entry = {"kernel": name, "text": call.text, "code": [symbol, _RESULTS[returned], held]}
        key = hashlib.sha256(f"{name} {call.text}".encode()).hexdigest()[:16]
        (folder / f"{key}.call").write_text(json.dumps(entry), encoding="utf-8")


def _emit(symbol: str, module: Callable[[], Any], folder: Path, every: bool) -> None:
    """Write an object file for each level of the processor."""
    code = None
    for level in levels(every):
        path = folder / level.name / f"{symbol}.o"
        if path.exists():
            continue  # of another process
        target = llvm.Target.from_default_triple()
        machine = target.create_target_machine(
            cpu=level.processor, features=level.options, opt=3, reloc="pic", codemodel="small"
        )
        code = code or module()
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(machine.emit_object(code))


def link(folder: Path, into: Path, every: bool = False) -> list[Path]:
    """Link the object files of a folder to libraries, one for each level, and write their table.

    Raises:
        OSError: if there is no C compiler, or it fails.
    """
    files = {level: into / f"kernels-{system()}-{level.name}.so" for level in levels(every)}
    into.mkdir(parents=True, exist_ok=True)
    for level, file in files.items():
        _link(folder / level.name, file)
    codes: dict[str, dict[str, Any]] = {}
    for path in sorted(folder.glob("*.call")):
        call = json.loads(path.read_text(encoding="utf-8"))
        codes.setdefault(call["kernel"], {})[call["text"]] = call["code"]
    table = {
        "interface": INTERFACE,
        "sources": sources(),
        "system": system(),
        "files": [
            [level.least, file.name, hashlib.sha256(file.read_bytes()).hexdigest()]
            for level, file in files.items()
        ],
        "codes": codes,
    }
    replace_file(into / TABLE, [json.dumps(table, indent=1).encode()])
    return list(files.values())


def _link(objects: Path, file: Path) -> None:
    """Link the objects of a level, without the C library, whose version then does not matter."""
    compiler = shutil.which(os.environ.get("CC", "cc"))
    if compiler is None:
        raise OSError("a C compiler is needed to link it (CC, cc)")
    (objects / "processor.c").write_text(_PROCESSOR, encoding="utf-8")
    names = "\n".join(path.name for path in sorted(objects.glob("*.o")))
    (objects / "objects").write_text(names, encoding="utf-8")
    options = ["-shared", "-fPIC", "-nostdlib", "-lgcc", "-Wl,--strip-all"]
    if sys.platform == "darwin":
        options = ["-dynamiclib", "-undefined", "dynamic_lookup"]
    scratch = objects / file.name  # a process that has the old file open keeps it
    command = [compiler, "-O2", "processor.c", "@objects", *options, "-o", str(scratch)]
    done = subprocess.run(command, cwd=objects, capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(done.stderr.strip())
    replace_file(file, [scratch.read_bytes()])
