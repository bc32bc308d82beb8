"""``flexarm warmup``: build the library of kernels, in parallel processes."""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path
from typing import Annotated

import typer

from flexarm.base.errors import InputError, Problem
from flexarm.cli.tables import console


def warmup(
    into: Annotated[
        Path | None,
        typer.Option(help="Folder of the library; by default the cache of this user."),
    ] = None,
    every: Annotated[
        bool,
        typer.Option(
            "--every-processor", help="For all processors of this family, not only this one."
        ),
    ] = False,
) -> None:
    """Compile all kernels to one library, so that no run waits; an installation brings one."""
    from flexarm.kernels.compilation import library
    from flexarm.kernels.compilation.private_folder import cache_folder

    screen = console()
    if into is None and (known := library.loaded()) is not None:
        screen.print(f"The library of kernels is in {known.folder}.")
        return
    folder = into or cache_folder()
    if folder is None:
        rule = "cannot be created as a private folder of this user"
        raise InputError(Problem("the cache folder", rule))
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as scratch:
        compiled = _compile(Path(scratch), every)
        from flexarm.kernels.compilation.build import link

        try:
            files = link(Path(scratch), folder, every)
        except OSError as error:
            raise InputError(Problem("the library of kernels", f"was not built: {error}")) from None
    took = time.perf_counter() - started
    for file in files:
        screen.print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")
    screen.print(f"Built in {took:.0f} s; compiling took {compiled:.0f} s of one core.")


def _compile(scratch: Path, every: bool) -> float:
    """Write object files of all kernels, and return the time of compiling, s."""
    from concurrent.futures import as_completed

    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    from flexarm.base.processes import process_pool, usable_cores
    from flexarm.cli.features import FEATURES, compile_feature

    # Code from a cache could not be exported, and code of a library is finished.
    os.environ |= {"XDG_CACHE_HOME": str(scratch), "FLEXARM_KERNELS": "compile"}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    bar = Progress(*columns, TimeElapsedColumn(), console=console(), transient=True)
    pool = process_pool(min(usable_cores(), len(FEATURES)), int)
    compiled = 0.0
    with bar, pool:
        task = bar.add_task("compiling", total=len(FEATURES))
        waiting = {pool.submit(compile_feature, name, scratch, every): name for name in FEATURES}
        for done in as_completed(waiting):
            compiled += done.result()
            bar.update(task, advance=1, description=f"compiled: {waiting[done]}")
    return compiled
