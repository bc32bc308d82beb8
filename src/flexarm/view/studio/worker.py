"""One computing process for all windows: the newest request of each wins."""

from __future__ import annotations

import gc
import multiprocessing
import signal
import threading
import time
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass
from itertools import count
from multiprocessing.connection import Connection
from typing import Any

#: Time (s) after which a run is stopped if a newer request of its window waits, and in any case.
PATIENCE, LONGEST = 2.0, 120.0
_POLL = 0.05
_RESTARTED = (
    "The computing process ended unexpectedly and was started again. Change a value to retry."
)
_TOO_LONG = "The run took longer than {:g} s and was stopped. Run it with `flexarm run`."

Job = Callable[[Any], Iterator[Any]]
#: Receives the number of the request and a part of its answer, in the thread of the worker.
Deliver = Callable[[int, Any], None]


@dataclass(frozen=True, eq=False)
class _Ticket:
    number: int
    request: Any
    deliver: Deliver
    stopped_by: frozenset[Hashable]  # owners whose waiting requests stop this one


class Worker:
    """Computes requests one at a time, in a process of its own so that the windows stay responsive.

    A new request replaces the waiting one of the same owner. Answers come in the order of their
    numbers, also those of requests that have been superseded: the owner drops them by number.
    ``failure`` returns the part of an answer to a request without one. A superseded run and any run
    are stopped after the times ``patience`` and ``longest``, s.
    """

    def __init__(
        self,
        job: Job,
        failure: Callable[[str], Any],
        patience: float = PATIENCE,
        longest: float = LONGEST,
    ) -> None:
        self._job, self._failure = job, failure
        self._patience, self._longest = patience, longest
        self._numbers = count(1)
        self._waiting: dict[Hashable, _Ticket] = {}
        self._change = threading.Condition()
        self._closed = False
        self._process: Any = None
        self._pipe: Connection | None = None
        self._thread = threading.Thread(target=self._dispatch, daemon=True)
        self._thread.start()

    def submit(
        self, owner: Hashable, request: Any, deliver: Deliver, after: Hashable = None
    ) -> int:
        """Compute a request in place of the waiting one of its owner; return its number.

        Requests of ``after``, another owner, stop this one as later requests of the same owner do.
        """
        with self._change:
            ticket = _Ticket(next(self._numbers), request, deliver, frozenset((owner, after)))
            self._waiting[owner] = ticket
            self._change.notify()
        return ticket.number

    def forget(self, owner: Hashable) -> None:
        """Drop the waiting request of an owner that has gone."""
        with self._change:
            self._waiting.pop(owner, None)

    def close(self) -> None:
        """End the process; requests that wait are dropped."""
        with self._change:
            self._closed = True
            self._waiting.clear()
            self._change.notify()
        self._thread.join()

    def _dispatch(self) -> None:
        self._start()
        while True:
            with self._change:
                self._change.wait_for(lambda: self._closed or self._waiting)
                if self._closed:
                    break
                owner = next(iter(self._waiting))
                ticket = self._waiting.pop(owner)
            self._serve(ticket)
        self._stop()

    def _serve(self, ticket: _Ticket) -> None:
        if self._process is None:
            self._start()
        pipe, began = self._pipe, time.monotonic()
        assert pipe is not None
        try:
            pipe.send(ticket.request)
            while True:
                if pipe.poll(_POLL):
                    part = pipe.recv()
                    if part is None:
                        return
                    ticket.deliver(ticket.number, part)
                    continue
                spent = time.monotonic() - began
                superseded = any(each in self._waiting for each in ticket.stopped_by)
                if self._closed or (superseded and spent > self._patience):
                    self._stop()
                    return
                if spent > self._longest:
                    self._stop()
                    ticket.deliver(ticket.number, self._failure(_TOO_LONG.format(self._longest)))
                    return
        except (EOFError, OSError):
            self._stop()
            ticket.deliver(ticket.number, self._failure(_RESTARTED))

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_compute, args=(other, self._job), daemon=True)
        self._process.start()
        other.close()

    def _stop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process.close()
        if self._pipe is not None:
            self._pipe.close()
        self._process = self._pipe = None


def _compute(pipe: Connection, job: Job) -> None:
    """Answer requests until the pipe closes; None ends an answer."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the server, which ends this process
    for number in count():
        try:
            request = pipe.recv()
        except EOFError:
            return
        for part in job(request):
            pipe.send(part)
        pipe.send(None)
        if number == 0:
            # Modules and compiled kernels stay: visits of the collector would delay later answers.
            gc.collect()
            gc.freeze()
