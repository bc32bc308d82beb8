"""Calls in several processes have the results of calls in one, in their order."""

import os
from functools import partial

import pytest

from flexarm.base import processes


def where(offset, k):
    return os.getpid(), offset + k


def dies(parent, k):
    if os.getpid() != parent:
        os._exit(1)
    return k


CALLS = [(k,) for k in range(8)]


def test_long_calls_continue_in_processes(monkeypatch):
    monkeypatch.setattr(processes, "WORTH", 0.0)
    found = list(processes.in_processes(partial(where, 100), CALLS, 2))
    assert [value for _, value in found] == list(range(100, 108))
    own = [k for k, (pid, _) in enumerate(found) if pid == os.getpid()]
    assert own == [0, 1]  # the second one is measured


@pytest.mark.parametrize(("workers", "worth"), [(1, 0.0), (2, 1e9)])
def test_other_calls_stay_in_this_process(workers, worth, monkeypatch):
    monkeypatch.setattr(processes, "WORTH", worth)
    found = list(processes.in_processes(partial(where, 0), CALLS, workers))
    assert found == [(os.getpid(), k) for k in range(8)]


@pytest.mark.thorough_cases("process dies")
@pytest.mark.parametrize("trouble", ["no semaphores", "process dies"])
def test_without_processes_this_one_continues(trouble, monkeypatch):
    monkeypatch.setattr(processes, "WORTH", 0.0)
    if trouble == "no semaphores":

        def refuse(*_):
            raise OSError(trouble)

        monkeypatch.setattr(processes, "process_pool", refuse)
    found = list(processes.in_processes(partial(dies, os.getpid()), CALLS, 2))
    assert found == list(range(8))


def test_cores_are_those_of_the_process(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {1, 5, 7}, raising=False)
    assert processes.usable_cores() == 3
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert processes.usable_cores() == 1
