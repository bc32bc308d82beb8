"""``flexarm warmup``: compile all kernels in advance, in parallel processes."""

from __future__ import annotations

import time

from flexarm.base.errors import InputError, Problem
from flexarm.cli.tables import console


def warmup() -> None:
    """Compile everything now, so that no later run waits; needed once on a machine."""
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
    from flexarm.kernels.compilation.cache import CACHE_DIRECTORY

    if CACHE_DIRECTORY is None:
        rule = "cannot be created as a private folder of this user"
        raise InputError(Problem("the cache folder", rule))
    screen = console()
    started = time.perf_counter()
    compiled = 0.0
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    bar = Progress(*columns, TimeElapsedColumn(), console=screen, transient=True)
    workers = min(usable_cores(), len(FEATURES))
    pool = process_pool(workers, int)
    with bar, pool:
        task = bar.add_task("compiling", total=len(FEATURES))
        waiting = {pool.submit(compile_feature, name): name for name in FEATURES}
        for done in as_completed(waiting):
            seconds, failure = done.result()
            if failure:
                raise InputError(Problem(str(CACHE_DIRECTORY), f"is not writable: {failure}"))
            compiled += seconds
            bar.update(task, advance=1, description=f"compiled: {waiting[done]}")
    took = time.perf_counter() - started
    screen.print(
        f"{len(FEATURES)} features are ready after {took:.0f} s; "
        f"{compiled:.0f} s of compiling in {workers} processes."
    )
