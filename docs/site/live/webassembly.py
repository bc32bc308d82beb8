"""Kernels as one WebAssembly module, from the same source as those of Python.

A process of its own lowers the kernels with Numba and collects their code before any optimization,
because that code does not depend on the processor. LLVM then links, optimizes and translates all of
it for wasm32, and the linker of ``ziglang`` writes the module. Numba's wrappers for Python are not
referenced and drop out.

The module exports a function ``NAME(table)`` for each kernel. The table contains the arguments, 8
bytes each: a number, or the address of an array.

WebAssembly has no instruction that rounds a product and a sum once. Its results therefore differ
from those of a processor with one in the last digits.
"""

from __future__ import annotations

import pickle
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from importlib import import_module
from pathlib import Path
from typing import IO, Any

_TRIPLE = "wasm32-unknown-unknown"
#: Instructions that browsers have had since 2021.
_FEATURES = "+bulk-memory,+nontrapping-fptoint,+sign-ext"
#: Functions that WebAssembly has no instruction for; the page imports those of ``Math``.
IMPORTED = ("exp", "log", "pow")


def webassembly(calls: Mapping[str, tuple[Callable[..., Any], tuple[Any, ...]]]) -> bytes:
    """Return the module with an exported function for each kernel.

    Args:
        calls: by name, a kernel and arguments of the types for which to compile it.
    """
    described = {
        name: (kernel.__module__, kernel.__name__, arguments)
        for name, (kernel, arguments) in calls.items()
    }
    compiler = subprocess.run(
        [sys.executable, __file__],
        input=pickle.dumps(described),
        stdout=subprocess.PIPE,
        check=True,
    )
    with tempfile.TemporaryDirectory() as folder:
        compiled, module = Path(folder, "kernels.o"), Path(folder, "kernels.wasm")
        compiled.write_bytes(compiler.stdout)
        exports = [f"--export={name}" for name in (*calls, "__heap_base")]
        options = ["--no-entry", "--strip-all", "--stack-first", "-z", "stack-size=262144"]
        linker = [sys.executable, "-m", "ziglang", "wasm-ld"]
        allowed = Path(folder, "imported")
        allowed.write_text("\n".join(IMPORTED))
        options.append(f"--allow-undefined-file={allowed}")
        subprocess.run([*linker, *options, *exports, str(compiled), "-o", str(module)], check=True)
        return module.read_bytes()


# In the process that compiles ------------------------------------------------------------------


def _lowered(pickled: IO[bytes]) -> tuple[dict[str, str], list[str]]:
    """Return the symbols of the kernels, and the code of all that they call, not optimized."""
    from flexarm.kernels.compilation import jit

    without_cache: Any = jit
    without_cache.cache_folder = lambda: None  # kernels from a cache have no code to collect

    import numba
    from numba.core import cgutils, codegen, cpu

    texts: list[str] = []
    library: Any = codegen.CPUCodeLibrary
    library.add_ir_module = lambda _, code: texts.append(cgutils.normalize_ir_text(str(code)))
    library.finalize = lambda self: setattr(self, "_finalized", True)
    # Nothing is executed here. Numba stores this by identity, and requires a built-in method.
    context: Any = cpu.CPUContext
    context.get_executable = lambda *_: [].append
    symbols = {}
    for name, (module, function, arguments) in pickle.load(pickled).items():
        kernel = getattr(import_module(module), function)
        types = tuple(map(numba.typeof, arguments))
        jit.declare_all()
        kernel.dispatcher.compile(types)
        symbols[name] = kernel.dispatcher.overloads[types].fndesc.llvm_func_name
    return symbols, texts


def _translated(symbols: Mapping[str, str], texts: list[str]) -> bytes:
    """Return an object file for wasm32 with the kernels and their entries."""
    import llvmlite.binding as llvm

    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    target = llvm.Target.from_triple(_TRIPLE)
    machine = target.create_target_machine(opt=3, cpu="generic", features=_FEATURES)
    whole: Any = None
    for text in texts:
        code = llvm.parse_assembly(_retargeted(text, str(machine.target_data)))
        for function in code.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "weak_odr"  # several modules contain the same function
        if whole is None:
            whole = code
        else:
            whole.link_in(code)
    parts = [_entry(name, whole.get_function(symbol)) for name, symbol in symbols.items()]
    whole.link_in(llvm.parse_assembly(_retargeted("\n".join(parts), str(machine.target_data))))
    for item in (*whole.functions, *whole.global_variables):
        if not item.is_declaration and item.name not in symbols:
            item.linkage = "internal"
    options = llvm.PipelineTuningOptions(2)
    options.loop_vectorization = options.slp_vectorization = False
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(whole, builder)
    return bytes(machine.emit_object(whole))


def _retargeted(text: str, layout: str) -> str:
    """Return code with another target, and with the instruction instead of the function sqrt."""
    lines = [line for line in text.splitlines() if not line.startswith("target ")]
    head = f'target triple = "{_TRIPLE}"\ntarget datalayout = "{layout}"\n'
    return head + re.sub(r'@"?sqrt"?\(', "@llvm.sqrt.f64(", "\n".join(lines))


def _entry(name: str, kernel: Any) -> str:
    """Return the code of a function that reads the arguments of a kernel from a table.

    It returns the kernel's integer, or -1 if the kernel has raised an exception.
    """
    types = [str(argument.type) for argument in kernel.arguments][2:]
    loads = "".join(
        f"  %p{k} = getelementptr i64, ptr %table, i32 {k}\n  %a{k} = load {kind}, ptr %p{k}\n"
        for k, kind in enumerate(types)
    )
    passed = "".join(f", {kind} %a{k}" for k, kind in enumerate(types))
    declared = ", ".join(["ptr", "ptr", *types])
    return f"""
declare i32 @"{kernel.name}"({declared})
define i32 @{name}(ptr %table) {{
  %result = alloca i64
  %failure = alloca ptr
  store i64 0, ptr %result
{loads}  %status = call i32 @"{kernel.name}"(ptr %result, ptr %failure{passed})
  %value = load i64, ptr %result
  %number = trunc i64 %value to i32
  %good = icmp sle i32 %status, 0
  %answer = select i1 %good, i32 %number, i32 -1
  ret i32 %answer
}}
"""


if __name__ == "__main__":
    sys.stdout.buffer.write(_translated(*_lowered(sys.stdin.buffer)))
