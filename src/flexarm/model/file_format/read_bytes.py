"""Reading of a file or a pipe, with a time limit for pipes that remain empty."""

from __future__ import annotations

import os
import select
import stat
import time
from pathlib import Path

#: Time limit for a writer to open a named pipe (s).
_WAIT_FOR_WRITER = 5.0
#: Time limit for the first content of a pipe (s); its writer may have to compute before.
_WAIT_FOR_CONTENT = 60.0
_AT_ONCE = 1 << 20


def read_bytes(file: Path, most: int) -> bytes:
    """Return the content of a file, a pipe or a terminal, at most ``most`` bytes.

    Raises:
        OSError: if it cannot be read, or is a pipe that has no writer or remains empty.
        ValueError: if the path has a null character or half of a surrogate pair.
    """
    flags = os.O_RDONLY | getattr(os, "O_BINARY", 0) | getattr(os, "O_NONBLOCK", 0)
    descriptor = os.open(file, flags)
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError
        return _read(descriptor, most, stat.S_ISFIFO(mode))
    finally:
        os.close(descriptor)


def _read(descriptor: int, most: int, pipe: bool) -> bytes:
    parts: list[bytes] = []
    length = 0
    start = time.monotonic()
    while length < most:
        try:
            part = os.read(descriptor, min(_AT_ONCE, most - length))
        except BlockingIOError:  # the writer has not written more yet
            limit = start + _WAIT_FOR_CONTENT - time.monotonic()
            wait = max(limit, 0.0) if pipe and not parts else None
            if not select.select([descriptor], [], [], wait)[0]:
                reason = f"nothing was written into the pipe for {_WAIT_FOR_CONTENT:g} s"
                raise OSError(reason) from None
            continue
        if part:
            parts.append(part)
            length += len(part)
        elif not pipe or parts:
            break
        elif time.monotonic() > start + _WAIT_FOR_WRITER:
            raise OSError("the pipe is empty, and nobody writes into it")
        else:
            time.sleep(0.02)
    return b"".join(parts)
