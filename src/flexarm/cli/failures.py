"""Failures on the command line, also of its streams: a message and an exit status."""

from __future__ import annotations

import io
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from typing import Any, ParamSpec

import typer

from flexarm.base.errors import FlexarmError, FlexarmWarning, InputError, printable

P = ParamSpec("P")

FAILED_RUN, WRONG_INPUT, INTERRUPTED, TERMINATED = 1, 2, 130, 143


def report_failures(command: Callable[P, None]) -> Callable[P, None]:
    """Decorate a command: report failures on the error stream and exit with their status.

    A problem without a location gets the name of the command, such as ``flexarm run``. Only
    exceptions that flexarm raises on purpose are handled. Any other exception is a bug, and keeps
    its traceback.
    """

    @wraps(command)
    def reporting(*args: P.args, **kwargs: P.kwargs) -> None:
        try:
            command(*args, **kwargs)
        except InputError as error:
            name = command.__name__.replace("_", " ")  # ``export_c`` is ``export c``
            print_error(str(error.at(f"flexarm {name}")))
            raise typer.Exit(WRONG_INPUT) from None
        except FlexarmError as error:
            print_error(str(error))
            raise typer.Exit(FAILED_RUN) from None
        except MemoryError:
            hint = "Lower run.rate or run.duration, or use fewer links, elements or modes."
            print_error(f"out of memory. {hint}")
            raise typer.Exit(FAILED_RUN) from None
        except KeyboardInterrupt:
            print_error("stopped by Ctrl-C")
            raise typer.Exit(INTERRUPTED) from None

    return reporting


def end_orderly_when_terminated() -> None:
    """Handle SIGTERM: remove temporary files and exit with status 143.

    Only the command line does this, because in Python the signal handlers belong to the importing
    program. An exception would be lost if the signal arrives in a finaliser, such as those of HDF5
    files.
    """

    def leave(*_: object) -> None:
        from flexarm.base.writing.replace_file import remove_unfinished

        remove_unfinished()
        # Flush the output streams, for at most a second.
        if hasattr(signal, "SIGALRM"):
            signal.signal(signal.SIGALRM, lambda *_: os._exit(TERMINATED))
            signal.alarm(1)
        for stream in (sys.stdout, sys.stderr):
            # The pipe may be closed, or the signal may have interrupted a write to the stream.
            with suppress(OSError, ValueError, RuntimeError):
                stream.flush()
        os._exit(TERMINATED)

    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, leave)


def warn(message: str) -> None:
    """Write a warning to the error stream: one line, yellow on a terminal."""
    from rich.console import Console

    screen = Console(stderr=True, highlight=False, markup=False, emoji=False)
    screen.print(f"warning: {printable(message)}", style="yellow", soft_wrap=True)


@contextmanager
def collected_warnings() -> Iterator[list[str]]:
    """Collect the texts of warnings in place of showing them; print them later with ``warn``."""
    texts: list[str] = []
    with warnings.catch_warnings(record=True) as records:
        warnings.simplefilter("always", FlexarmWarning)
        yield texts
    texts += [str(record.message) for record in records]


@contextmanager
def reported_warnings() -> Iterator[None]:
    """Write the warnings of a block with ``warn`` at its end."""
    with collected_warnings() as texts:
        yield
    for text in dict.fromkeys(texts):
        warn(text)


def print_error(message: str) -> None:
    """Write a message to the error stream unformatted, because editors and scripts parse it."""
    lines = map(printable, message.split("\n"))
    print("\n".join(lines), file=sys.stderr, flush=True)


class _OutputError(Exception):
    """The standard output cannot be written."""


class _Stream(io.RawIOBase):
    """Bytes of a standard stream, which are discarded after the first failure.

    Only the main thread raises, because Python prints a traceback of an exception in another one,
    such as that of a progress bar. With ``raises``, the first ``failure`` raises `_OutputError`.
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
