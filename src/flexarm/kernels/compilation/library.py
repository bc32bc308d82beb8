"""The library of kernels: machine code that was built in advance, and calls of it without Numba.

A library is one file of the platform's format, with a table beside it: the symbol of each kernel
for each combination of types of arguments, written as text by `signature`. A function of the
library receives the address of a block of words of eight bytes: a number, or the address of an
array's object, whose data, shape and strides it reads. NumPy keeps these places for all extension
modules; `_reads_arrays` tests them when a library is loaded.
"""

from __future__ import annotations

import ctypes
import functools
import hashlib
import json
import os
import platform
import struct
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from flexarm.kernels.compilation.private_folder import cache_folder, sources

#: What determines the machine code of a call: types, and for arrays dtype, axes and flags.
Kinds = tuple[Any, ...]
#: Version of what a library and its callers agree on: words, entry points, the table.
INTERFACE = 1
#: File beside a library: what it fits, its files by processor, and symbols by kernel and types.
TABLE = "kernels.json"
#: "compile": do not use a library; "library": never compile; otherwise compile what it lacks.
CHOICE = os.environ.get("FLEXARM_KERNELS", "")
#: Folder of the library that comes with an installation.
INSTALLED = Path(__file__).parents[1] / "machine_code"
#: Flags of an array that determine the code: contiguous (C, F), aligned, writable.
_CONTIGUOUS, _FORTRAN, _ALIGNED, _WRITABLE = 0x1, 0x2, 0x100, 0x400
_TYPED = _CONTIGUOUS | _FORTRAN | _ALIGNED | _WRITABLE
_AXES = 1 << 16
_NUMBERS: dict[type, str] = {
    float: "d", np.float64: "d", int: "q", np.int64: "q", bool: "?",
}  # fmt: skip


class Blocks:
    """Array of numbers of several float64, which are the last axis of ``array``."""

    #: Number of float64 of a number.
    width: ClassVar[int]

    def __init__(self, array: NDArray[np.float64]) -> None:
        fits = array.shape[-1] == self.width and array.dtype == np.float64
        if not fits or not array.flags.c_contiguous:
            kind = type(self).__name__
            raise ValueError(f"{kind} are contiguous float64 arrays, {self.width} to a number")
        self.array = array

    @classmethod
    def zeros(cls, *shape: int) -> Self:
        """Return zeros."""
        return cls(np.zeros((*shape, cls.width)))


def flatten(values: tuple[Any, ...], kinds: list[Any], words: list[Any]) -> None:
    """Append what determines the machine code of a call, and its words, to two lists."""
    for value in values:
        kind = type(value)
        if kind is np.ndarray:
            kinds.append(value.dtype)
            kinds.append(value.flags.num & _TYPED | value.ndim * _AXES)
            words.append(id(value))
        elif isinstance(value, tuple):
            kinds.append(kind)
            kinds.append(len(value))
            flatten(value, kinds, words)
        elif isinstance(value, Blocks):
            kinds.append(kind)
            kinds.append(value.array.ndim)
            words.append(id(value.array))
        else:
            kinds.append(kind)
            words.append(value)


def signature(kinds: Kinds) -> str:
    """Return kinds of arguments as a text, such as ``f8:3C d q`` for an array and two numbers.

    Raises:
        KeyError: for a type that no kernel of a library has.
    """
    words, rest = [], iter(kinds)
    for kind in rest:
        if isinstance(kind, np.dtype):
            flags = next(rest)
            order = "C" if flags & _CONTIGUOUS else "F" if flags & _FORTRAN else "A"
            order += "" if flags & _WRITABLE else "r"
            order += "" if flags & _ALIGNED else "u"
            words.append(f"{kind.str.lstrip('<=|')}:{flags // _AXES}{order}")
        elif issubclass(kind, tuple):  # records may have the same fields in another order
            words.append(f"({kind.__module__}.{kind.__qualname__}:{next(rest)}")
        elif issubclass(kind, Blocks):
            words.append(f"{kind.__name__}:{next(rest)}")
        else:
            words.append(_NUMBERS[kind])
    return " ".join(words)


def block_format(text: str) -> str:
    """Return the format of a block of words, for ``struct``, of a `signature`."""
    words = (word for word in text.split(" ") if not word.startswith("("))
    return "=q" + "".join("d" if word == "d" else "q" for word in words if word)


class _Answer(ctypes.Structure):
    """What a kernel with a result returns."""

    _fields_: ClassVar = [("failed", ctypes.c_int64), ("word", ctypes.c_int64)]


class Code:
    """Machine code of a kernel for one `signature`."""

    __slots__ = ("_function", "_pack", "_result")

    def __init__(self, function: Any, text: str, result: str) -> None:
        self._function, self._result = function, result
        function.argtypes = [ctypes.c_char_p]
        function.restype = _Answer if result else ctypes.c_int64
        self._pack = struct.Struct(block_format(text)).pack

    def block(self, words: list[Any]) -> bytes:
        """Return the block of a call; arrays must exist until the call has returned."""
        return self._pack(_HEAD, *words)

    def run(self, block: bytes) -> Any:
        """Call the code with a block.

        Raises:
            ZeroDivisionError: as the same code of Numba: for complex numbers, the only exception
                of kernels.
        """
        answer = self._function(block)
        failed = answer.failed if self._result else answer
        if failed:
            raise ZeroDivisionError("complex division by zero")
        if not self._result:
            return None
        number: int = answer.word
        if self._result == "d":
            return struct.unpack("=d", struct.pack("=q", number))[0]
        return bool(number) if self._result == "?" else number

    def __call__(self, words: list[Any]) -> Any:
        """Call the code with words from `flatten`."""
        return self.run(self.block(words))


#: Bytes of an object before the fields of its type.
_HEAD = object.__basicsize__


def _reads_arrays() -> bool:
    """Return whether the fields of an array are where libraries read them."""
    if sys.implementation.name != "cpython" or ctypes.sizeof(ctypes.c_void_p) != 8:
        return False
    array = np.zeros((2, 3))[:, 1:]
    fields = (ctypes.c_int64 * 4).from_address(id(array) + _HEAD)
    numbers = ctypes.c_int64 * 2
    shape, strides = (tuple(numbers.from_address(fields[k])) for k in (2, 3))
    return fields[0] == array.ctypes.data and shape == array.shape and strides == array.strides


class Library:
    """A library of kernels, loaded.

    Raises:
        OSError: if the file cannot be read or loaded, or does not fit the system, the sources, the
            processor or the version of the interface.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        table = json.loads((folder / TABLE).read_text(encoding="utf-8"))
        for name, value in (("interface", INTERFACE), ("system", system()), ("sources", sources())):
            if table.get(name) != value:
                raise OSError(f"{name} {table.get(name)} of {folder} instead of {value}")
        self.names = [name for _, name, _ in table["files"]]
        for least, name, digest in table["files"]:
            file = folder / name
            if hashlib.sha256(file.read_bytes()).hexdigest() != digest:
                raise OSError(f"{file} is damaged")
            self.file, self._held = file, ctypes.PyDLL(str(file))
            if self._held.flexarm_processor() >= least:
                break
        else:
            raise OSError("this processor is older than those of the library")
        self._released = ctypes.CDLL(str(file))
        self._codes = table["codes"]

    def code(self, kernel: str, kinds: Kinds) -> Code | None:
        """Return the code of a kernel for kinds of arguments, or None."""
        try:
            text = signature(kinds)
            symbol, result, held = self._codes[kernel][text]
            function = getattr(self._held if held else self._released, symbol)
        except (KeyError, AttributeError):
            return None
        return Code(function, text, result)


def system() -> str:
    """Return the system and the processor family, such as ``linux-x86_64``."""
    return f"{sys.platform}-{platform.machine().lower()}"


#: Why there is no library: the first reason, or nothing.
_reasons: list[str] = []


@functools.cache
def loaded() -> Library | None:
    """Return the library of the installation, or of the user's cache; None without one."""
    _reasons.clear()
    if CHOICE == "compile" or not _reads_arrays():
        _reasons.append("libraries of kernels are not used here")
        return None
    for folder in _folders():
        try:
            return Library(folder)
        except FileNotFoundError:
            continue
        except (OSError, ValueError, LookupError, TypeError, AttributeError) as error:
            _reasons.append(f"the library in {folder} does not fit: {error}")
    return None


def reason() -> str:
    """Return why a kernel is not in the library."""
    if loaded() is not None:
        return "the library does not contain it"
    return _reasons[0] if _reasons else "there is no library"


def _folders() -> Iterator[Path]:
    yield INSTALLED
    if (folder := cache_folder()) is not None:
        yield folder
