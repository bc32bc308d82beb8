"""``flexarm warmup``: build the library of kernels, in parallel processes."""

from __future__ import annotations

import os
import shutil
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
    present = None if every else library.loaded()
    if present is not None:
        if into is not None:
            into.mkdir(parents=True, exist_ok=True)
            for name in (library.TABLE, *present.names):
                shutil.copy(present.folder / name, into / name)
        screen.print(f"The library of kernels is in {present.folder}.")
        return
    folder = into or cache_folder()
    if folder is None:
        rule = "cannot be created as a private folder of this user"
        raise InputError(Problem("the cache folder", rule))
    started = time.perf_counter()
    if shutil.which(os.environ.get("CC", "cc")) is None:
        if into is not None:
            raise InputError(Problem("the library of kernels", "needs a C compiler (CC, cc)"))
        compiled = _compile(None, every)
        screen.print("There is no C compiler (CC, cc) to link a library: each kernel has a file.")
    else:
        from flexarm.kernels.compilation.build import link

        with tempfile.TemporaryDirectory() as scratch:
            compiled = _compile(Path(scratch), every)
            try:
                files = link(Path(scratch), folder, every)
            except OSError as error:
                rule = f"was not built: {error}"
                raise InputError(Problem("the library of kernels", rule)) from None
            for file in files:
                screen.print(f"{file}: {file.stat().st_size / 1e6:.1f} MB")
    took = time.perf_counter() - started
    screen.print(f"Ready after {took:.0f} s; compiling took {compiled:.0f} s of one core.")


def _compile(scratch: Path | None, every: bool) -> float:
    """Compile all kernels, and return the time, s; with ``scratch``, write object files there."""
    from concurrent.futures import as_completed

    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
    )

    from flexarm.base.processes import process_pool, usable_cores
    from flexarm.cli.features import compile_features, groups

    # The processes inherit this: code that comes from a library cannot be exported.
    os.environ["FLEXARM_KERNELS"] = "compile"
    columns = TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn()
    bar = Progress(*columns, TimeElapsedColumn(), console=console(), transient=True)
    tasks, compiled = groups(), 0.0
    with bar, process_pool(min(usable_cores(), len(tasks)), int) as pool:
        task = bar.add_task("compiling groups of kernels", total=len(tasks))
        for done in as_completed([pool.submit(compile_features, g, scratch, every) for g in tasks]):
            compiled += done.result()
            bar.update(task, advance=1)
    return compiled
