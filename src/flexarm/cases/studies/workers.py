"""Execution of chunks by the workers of a Dask cluster, which may die and be replaced."""

from __future__ import annotations

import logging
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from flexarm.base.arguments import library_missing
from flexarm.base.errors import InputError, Problem, shown

#: Tasks that wait or run for each thread of the cluster, so that no worker idles between two.
_AHEAD = 3
#: How often a chunk may end with its workers, each time after three attempts of Dask.
_MOST_LOSSES = 3


def check_client(client: object) -> None:
    """Raise if a value is neither a client of Dask, nor an address, nor None.

    Raises:
        InputError: if it is none of these, or Dask is not installed.
    """
    if client is None:
        return
    rule = "be a Client of Dask or the address of a scheduler"
    hint = "An address is text such as 'tcp://host:8786'."
    distributed = _distributed()
    if isinstance(client, str):
        right = re.fullmatch(r"\w+://[^\s/]+:\d+", client) is not None
    else:
        right = isinstance(client, distributed.Client)
    if not right:
        raise InputError(Problem("client", rule, shown(client), hint))


def _distributed() -> Any:
    try:
        import distributed
    except ImportError:
        raise library_missing("distributed", "cluster") from None
    return distributed


@contextmanager
def cluster(client: object, workers: int) -> Iterator[Any]:
    """Provide a client of Dask.

    Args:
        client: as for ``check_client``; None for processes of this computer.
        workers: number of those processes.

    Raises:
        InputError: if Dask is not installed, or there is no scheduler at the address.
    """
    distributed = _distributed()
    if client is None:
        # One thread for each process: most of a run is Python code, and threads take turns at it.
        try:
            local = distributed.LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                memory_limit=None,
                silence_logs=logging.ERROR,
                # Not the default port, which may be in use: Dask would warn.
                dashboard_address="127.0.0.1:0",
                worker_dashboard_address="127.0.0.1:0",
                scheduler_kwargs={"dashboard": False},
            )
        except RuntimeError:
            hint = 'A script needs the guard `if __name__ == "__main__":`; workers=1 does not.'
            raise InputError(Problem("workers", "could not be started", hint=hint)) from None
        with local, distributed.Client(local) as own:
            yield own
    elif isinstance(client, str):
        try:
            connected = distributed.Client(client)
        except OSError:
            rule = "be the address of a scheduler that runs"
            raise InputError(Problem("client", rule, shown(client))) from None
        with connected:
            yield connected
    else:
        yield client


def execute(
    client: Any,
    task: Callable[..., Any],
    arguments: Sequence[tuple[Any, ...]],
    done: Callable[[int, Any], None],
) -> None:
    """Call ``task`` with each of ``arguments`` on a cluster.

    Args:
        done: called with the place of the arguments and the result, in the order of completion.

    Raises:
        InputError: if a task raises it, or repeatedly ends together with its worker, or the
            scheduler is lost.
    """
    from distributed import CancelledError, KilledWorker, as_completed

    completed: Any = as_completed  # without annotations
    waiting, places, losses = completed(), {}, Counter[int]()
    left = iter(range(len(arguments)))

    def submit(place: int) -> None:
        future = client.submit(task, *arguments[place], pure=False)
        places[future.key] = place
        waiting.add(future)

    def fill() -> None:
        most = _AHEAD * max(1, sum(client.nthreads().values()))
        while len(places) < most and (place := next(left, None)) is not None:
            submit(place)

    fill()
    for future in waiting:
        place = places.pop(future.key)
        try:
            result = future.result()
        except KilledWorker:
            losses[place] += 1
            if losses[place] >= _MOST_LOSSES:
                rule = f"ended the process of each worker that executed task {arguments[place]}"
                hint = "Its memory may not suffice."
                raise InputError(Problem("study", rule, hint=hint)) from None
            submit(place)
            continue
        except CancelledError:
            hint = "Resume the study."
            raise InputError(Problem("client", "has lost its scheduler", hint=hint)) from None
        finally:
            future.release()
        done(place, result)
        fill()
