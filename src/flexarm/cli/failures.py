"""What users see when something fails: a message, an exit status, no traceback."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

import typer

from flexarm.errors import FlexarmError, InputError

FAILED_RUN, WRONG_INPUT, INTERRUPTED = 1, 2, 130


@contextmanager
def failures_told() -> Iterator[None]:
    """Tell failures on the error stream and leave with the exit status that belongs to them.

    Only what flexarm raises on purpose: anything else is a bug, and its traceback is wanted.
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


def warn(message: str) -> None:
    """Write a warning to the error stream: one line, yellow on a terminal."""
    from rich.console import Console

    screen = Console(stderr=True, highlight=False, markup=False, emoji=False)
    screen.print(f"warning: {message}", style="yellow", soft_wrap=True)


def say(message: str) -> None:
    """Write a message to the error stream, as it is: editors and scripts read these lines."""
    print(message, file=sys.stderr, flush=True)
