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
import shutil
import stat
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
from platformdirs import user_cache_dir

from flexarm.base.writing.replace_file import replace_file
from flexarm.kernels.compilation.numba_internals import CAN_LINK, CAN_SAVE, rebuilt, serialized

code_library: Any = None
if CAN_LINK:
    from flexarm.kernels.compilation import code_library

#: Packages whose sources determine the machine code.
_SOURCE_FOLDERS = ("kernels", "integrate")
_UNUSED_CACHE_SECONDS = 60 * 24 * 3600
_DIGEST_BYTES = hashlib.sha256().digest_size


def _source_hash() -> str:
    package = Path(__file__).resolve().parents[2]
    digest = hashlib.sha256(numba.__version__.encode())
    for folder in _SOURCE_FOLDERS:
        for path in sorted((package / folder).rglob("*.py")):
            digest.update(path.relative_to(package).as_posix().encode())
            digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def cache_folder() -> Path | None:
    """Return the folder for these sources, created if missing; None if no folder is private.

    It is in the user's cache folder or, if that is not writable, in a folder of the temporary
    directory that belongs to this user and that nobody else can open.
    """
    name = f"kernels-{_source_hash()}"
    for root in _roots():
        folder = root / name
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not _is_private(folder):
                continue
            with tempfile.TemporaryFile(dir=folder):
                pass
            _forget_unused(root, keep=folder)
        except OSError:
            continue
        return folder
    return None


def _roots() -> Iterator[Path]:
    home = Path(user_cache_dir("flexarm"))
    if home.is_absolute():  # the path of a user without a home directory starts with "~"
        yield home
    try:
        shared = Path(tempfile.gettempdir()) / f"flexarm-{_user()}"
        shared.mkdir(mode=0o700, exist_ok=True)
        # Any user can create a folder with this name, so its owner and mode are checked.
        if _is_private(shared, others=0o077):
            yield shared
    except OSError:
        return


def _user() -> int:
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _is_private(folder: Path, others: int = 0o022) -> bool:
    """Return whether a path is a folder of this user, without the permissions ``others``.

    A link to such a folder does not count.
    """
    if not hasattr(os, "geteuid"):
        return True  # on Windows, the folders of a user are closed to others by default
    status = os.lstat(folder)
    ours = stat.S_ISDIR(status.st_mode) and status.st_uid == _user()
    return ours and not status.st_mode & others


def _forget_unused(root: Path, keep: Path) -> None:
    """Remove the machine code of sources that have not been used for two months."""
    (keep / ".used").touch()
    for old in root.glob("kernels-*"):
        stamp = old / ".used"
        if old != keep and stamp.exists():
            age = time.time() - stamp.stat().st_mtime
            if age > _UNUSED_CACHE_SECONDS:
                shutil.rmtree(old, ignore_errors=True)


class CodeCache:
    """Cache of the machine code of one kernel, with the methods that its Numba dispatcher calls."""

    #: Why code compiled by this process could not be saved; empty if all of it was saved.
    failure = ""

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
                if os.fstat(stream.fileno()).st_uid != _user():
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
        system = codegen.magic_tuple(), sys.implementation.cache_tag
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
