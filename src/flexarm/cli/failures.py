"""What users see when something fails: a message, an exit status, no traceback."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import typer

from flexarm.errors import FlexarmError, InputError, printable

FAILED_RUN, WRONG_INPUT, INTERRUPTED, TERMINATED = 1, 2, 130, 143


@contextmanager
def failures_told() -> Iterator[None]:
    """Report failures on the error stream and end with the exit status of each.

    Only exceptions that flexarm raises on purpose: any other is a bug, and its traceback is wanted.
    """
    try:
        yield
    except InputError as error:
        say(str(error))
        raise typer.Exit(WRONG_INPUT) from None
    except FlexarmError as error:
        say(str(error))
        raise typer.Exit(FAILED_RUN) from None
    except MemoryError:
        say("out of memory. Lower run.rate or run.duration, or use fewer links, elements or modes.")
        raise typer.Exit(FAILED_RUN) from None
    except KeyboardInterrupt:
        say("stopped by Ctrl-C")
        raise typer.Exit(INTERRUPTED) from None


def end_orderly_when_terminated() -> None:
    """Let SIGTERM remove temporary files and end the process with status 143.

    Only for the command: in Python, signals belong to the program that imports the package. An
    exception would be lost if the signal arrives in a finaliser, of which HDF5 files have many.
    """

    def leave(*_: object) -> None:
        from flexarm.replace_file import remove_unfinished

        remove_unfinished()
        _flush_briefly()
        os._exit(TERMINATED)

    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, leave)


def _flush_briefly() -> None:
    """Write out what was printed, unless its reader does not take it within a second."""
    if hasattr(signal, "SIGALRM"):
        signal.signal(signal.SIGALRM, lambda *_: os._exit(TERMINATED))
        signal.alarm(1)
    for stream in (sys.stdout, sys.stderr):
        # The reader may have gone, or the signal may have arrived within a write to the stream.
        with suppress(OSError, ValueError, RuntimeError):
            stream.flush()


def warn(message: str) -> None:
    """Write a warning to the error stream: one line, yellow on a terminal."""
    from rich.console import Console

    screen = Console(stderr=True, highlight=False, markup=False, emoji=False)
    screen.print(f"warning: {printable(message)}", style="yellow", soft_wrap=True)


def say(message: str) -> None:
    """Write a message to the error stream without layout: editors and scripts read these lines."""
    lines = map(printable, message.split("\n"))
    print("\n".join(lines), file=sys.stderr, flush=True)
