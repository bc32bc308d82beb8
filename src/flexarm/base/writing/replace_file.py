"""Atomic replacement of a file: readers find the old or the new content, never a part of it.

The content is written to a temporary file beside the target, which is then renamed to the target. A
process that is killed leaves its temporary file behind; the next process that writes the same
target removes it. Abandoned files are recognised by a lock that the operating system releases when
the writing process ends. A process number in the name would not be sufficient, because numbers are
reused, and processes in different containers have the same ones.
"""

from __future__ import annotations

import errno
import hashlib
import os
import stat
from collections.abc import Iterable
from pathlib import Path
from typing import BinaryIO

try:
    import fcntl
except ImportError:  # Windows, which does not remove an open file
    fcntl = None  # type: ignore[assignment]


#: Temporary files that this process is writing.
_unfinished: set[Path] = set()


def remove_unfinished() -> None:
    """Remove the temporary files of this process before it ends."""
    for beside in list(_unfinished):
        beside.unlink(missing_ok=True)


def replace_file(
    path: str | os.PathLike[str], parts: Iterable[bytes | memoryview], durable: bool = True
) -> None:
    """Write a file from parts, one after the other, in place of an older one.

    A symbolic link is kept: the file to which it refers is replaced. Permissions of an older file
    are kept. If anything fails, the older file is unchanged and no other file remains.

    Libraries that write files do not get the stream, because HDF5 crashes the process if the disk
    is full.

    The folder must exist; the parts may be computed while they are written. ``durable`` content is
    on the disk, not only in the system's buffers, before it replaces the older file, which is not
    necessary for a file that can be recomputed. Failures are those of the system, OSError.
    """
    try:
        target = Path(os.path.realpath(path))
        _remove_stale(target)
        mode = stat.S_IMODE(target.stat().st_mode) if target.exists() else None
        stream = _open_beside(target, mode)
    except ValueError as error:  # a null character, or half of a surrogate pair
        raise OSError(errno.EINVAL, str(error)) from None
    beside = Path(stream.name)
    try:
        with stream:
            if mode is not None:
                os.chmod(beside, mode)  # the process's mask may have removed bits
            stream.writelines(parts)
            stream.flush()
            if durable:
                os.fsync(stream.fileno())
            if fcntl is None:
                stream.close()  # Windows does not rename an open file
            os.replace(beside, target)
    finally:
        beside.unlink(missing_ok=True)
        _unfinished.discard(beside)


def _prefix(target: Path) -> str:
    """Return the prefix of temporary files for this target, with a hash because names are long."""
    name = hashlib.sha256(os.fsencode(target.name)).hexdigest()[:12]
    return f".flexarm-{name}-"


def _open_beside(target: Path, mode: int | None) -> BinaryIO:
    """Create and lock a temporary file beside the target, with the permissions of the older file.

    Users who may not read that must not be able to open the new one, even while it is still empty.
    """

    def create(path: str, flags: int) -> int:
        return os.open(path, flags, 0o666 if mode is None else mode & 0o777)

    while True:
        beside = target.with_name(f"{_prefix(target)}{os.urandom(6).hex()}.tmp")
        _unfinished.add(beside)
        try:
            stream = open(beside, "xb", opener=create)  # noqa: SIM115  (closed by the caller)
        except BaseException:
            _unfinished.discard(beside)
            raise
        try:
            # Another process may have removed it as stale before it was locked.
            if _lock(stream) and beside.exists():
                return stream
        except BaseException:
            stream.close()
            beside.unlink(missing_ok=True)
            _unfinished.discard(beside)
            raise
        stream.close()
        _unfinished.discard(beside)


def _lock(stream: BinaryIO) -> bool:
    """Lock a file until it is closed; return False if another process holds the lock."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:  # a file system without locks
        return True
    return True


def _open_at_once(path: str, flags: int) -> int:
    """Open a file for reading, without following a link or waiting for the writer of a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOFOLLOW", 0))


def _remove_stale(target: Path) -> None:
    """Remove temporary files for this target that no process is writing."""
    for beside in target.parent.glob(f"{_prefix(target)}*.tmp"):
        try:
            with open(beside, "rb", opener=_open_at_once) as stream:
                regular = stat.S_ISREG(os.fstat(stream.fileno()).st_mode)
                if regular and _lock(stream):
                    if fcntl is None:
                        stream.close()
                    beside.unlink()
        except OSError:  # removed by another process, in use, or owned by another user
            continue
