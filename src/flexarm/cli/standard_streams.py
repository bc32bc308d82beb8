"""Standard streams of the command line, whose failures end in a message and an exit status."""

from __future__ import annotations

import io
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from flexarm.cli.failures import WRONG_INPUT, print_error


class _OutputError(Exception):
    """The standard output cannot be written."""


class _Stream(io.RawIOBase):
    """Bytes of a standard stream, which are discarded after the first failure.

    Only the main thread raises, because Python prints a traceback of an exception in another one,
    such as that of a progress bar.

    Args:
        raises: whether the first failure raises `_OutputError`.

    Attributes:
        failure: reason of the failure; empty if there is none.
    """

    def __init__(self, stream: io.TextIOWrapper, raises: bool) -> None:
        # The buffer of `python -u` is the file itself.
        self._raw: Any = getattr(stream.buffer, "raw", stream.buffer)
        self._raises, self.failure = raises, ""

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return bool(self._raw.isatty())

    def fileno(self) -> int:
        return int(self._raw.fileno())

    def write(self, data: Any) -> int:
        if not self.failure:
            try:
                return int(self._raw.write(data))
            except OSError as error:
                self.failure = error.strerror or str(error)
                if self._raises and threading.current_thread() is threading.main_thread():
                    raise _OutputError from None
        return memoryview(data).nbytes


@contextmanager
def checked_streams() -> Iterator[None]:
    """Report a standard output that cannot be written, such as on a full disk, with status 2.

    A closed pipe counts, too. An error stream that cannot be written is ignored, because nothing
    can be reported then, and no run should end for it. The streams of the process are replaced, for
    all writers: ``print``, Typer and Rich.
    """
    output = _replace("stdout", raises=True)
    _replace("stderr", raises=False)
    try:
        yield
    except _OutputError:
        pass
    finally:
        if output is not None:
            with suppress(_OutputError):
                sys.stdout.flush()
            if output.failure:
                print_error(f"flexarm: standard output could not be written: {output.failure}.")
                sys.exit(WRONG_INPUT)


def _replace(name: str, raises: bool) -> _Stream | None:
    """Replace a stream of the process; return None if a program has replaced it by its own."""
    stream = getattr(sys, name)
    if type(stream) is not io.TextIOWrapper:
        return None
    stream.flush()
    checked = _Stream(stream, raises)
    text = io.TextIOWrapper(
        io.BufferedWriter(checked),
        stream.encoding,
        "backslashreplace",  # as Python's error stream, for characters that the encoding lacks
        line_buffering=stream.line_buffering or stream.write_through,
    )
    setattr(sys, name, text)
    return checked
