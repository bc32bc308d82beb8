"""Cache of machine code on disk, in a private folder and with a checksum.

Numba's own disk cache is not used, for four reasons. It checks only the file of the called
function, so after an edit of a kernel that this function calls it would return outdated code. It
loads a file without checking it: a damaged file raises at every start or, if the machine code
itself is damaged, executes it. Two processes that compile at the same time can leave an index that
refers to the code of other argument types. If its folder is not writable, it uses another one.

Here the name of the folder contains a hash of all sources of the kernels. Each file contains the
code of one kernel for one combination of argument types, preceded by a digest and by its key: the
sources, the kernel and the types. A file that is damaged, that is of another kernel, or that
belongs to another user, is discarded and compiled again. Errors of the cache never stop a run.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import numba

from flexarm.base.writing.replace_file import replace_file
from flexarm.kernels.compilation.numba_internals import CAN_LINK, CAN_SAVE, rebuilt, serialized
from flexarm.kernels.compilation.private_folder import user

code_library: Any = None
if CAN_LINK:
    from flexarm.kernels.compilation import code_library

_DIGEST_BYTES = hashlib.sha256().digest_size


class CodeCache:
    """Cache of the machine code of one kernel, with the methods that its Numba dispatcher calls."""

    #: Why code compiled by this process could not be saved; empty if all of it was saved.
    failure = ""
    #: Kernels and their versions that this process compiled, if it builds a library.
    compiled: ClassVar[list[tuple[Any, Any]] | None] = None

    def __init__(self, function: Callable[..., Any], folder: Path, apart: bool) -> None:
        self._function = function
        self._apart = apart
        self._folder = folder
        self._stamp = "" if function.__module__.startswith("flexarm.") else _file_hash(function)

    @property
    def cache_path(self) -> str:
        """Path of the folder."""
        return str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Return the compiled code for the argument types ``sig``, or None if it is not cached."""
        target_context.refresh()
        key = self._key(sig, target_context.codegen())
        path = self._path(key)
        try:
            with open(path, "rb") as stream:
                if os.fstat(stream.fileno()).st_uid != user():
                    return None
                content = stream.read()
        except OSError:
            return None
        try:
            digest, body = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
            if hashlib.sha256(body).digest() == digest:
                written_key, needed, code = pickle.loads(body)
                if written_key == key:
                    if code_library:
                        code_library.load(needed)
                    version = rebuilt(target_context, code)
                    if code_library and self._apart:
                        code_library.set_apart(self._function, version)
                    return version
        except Exception:
            # The file may come from another version of a library, which raises arbitrary errors.
            pass
        with contextlib.suppress(OSError):  # the folder may have become read-only
            path.unlink()
        return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save the compiled code ``data`` for the argument types ``sig``."""
        addresses = code_library.has_addresses if code_library else _has_addresses
        if data.lifted or addresses(data):
            return  # the code contains addresses of this process
        key = self._key(sig, data.codegen)
        needed = code_library.references(data) if code_library else []
        body = serialized(key, needed, data)
        if code_library and self._apart:
            code_library.set_apart(self._function, data)
            if CodeCache.compiled is not None:
                CodeCache.compiled.append((self._function, data))
        digest = hashlib.sha256(body).digest()
        try:
            replace_file(self._path(key), [digest, body], durable=False)
        except OSError as error:
            CodeCache.failure = error.strerror or str(error)

    def flush(self) -> None:
        """Remove the code of this kernel for all argument types."""
        for path in self._folder.glob(f"{self._name()}-*.code"):
            with contextlib.suppress(OSError):
                path.unlink()

    def _name(self) -> str:
        name = f"{self._function.__module__}.{self._function.__qualname__}"
        return name.replace("<", "").replace(">", "")

    def _path(self, key: tuple[Any, ...]) -> Path:
        # Equal types have equal texts unless a text contains an address, which costs only a miss.
        name = hashlib.sha256(str(key).encode()).hexdigest()[:16]
        return self._folder / f"{self._name()}-{name}.code"

    def _key(self, sig: Any, codegen: Any) -> tuple[Any, ...]:
        """Return the key of the machine code: the kernel and all on which its code depends.

        The name of the folder stands for the package's sources, so that a file that was moved from
        another folder, or renamed, does not match.
        """
        function = self._function
        kernel = self._folder.name, function.__module__, function.__qualname__
        bytecode = hashlib.sha256(function.__code__.co_code).hexdigest()
        system = codegen.magic_tuple(), sys.implementation.cache_tag, numba.__version__
        return (*kernel, sig, *system, bytecode, self._stamp)


def _has_addresses(version: Any) -> bool:
    return bool(version.library.has_dynamic_globals)


def _file_hash(function: Callable[..., Any]) -> str:
    """Return a hash of the file of a kernel outside the package."""
    return hashlib.sha256(Path(function.__code__.co_filename).read_bytes()).hexdigest()


def cache_of(function: Callable[..., Any], folder: Path | None, apart: bool) -> CodeCache | None:
    """Return the cache of a kernel; None if it has no source file, or its code cannot be saved."""
    has_file = Path(function.__code__.co_filename).is_file()
    saved = CAN_SAVE and folder is not None and has_file
    return CodeCache(function, folder, apart) if saved and folder else None
