"""Worker of the studio: order, replaced requests, stopped and lost processes."""

import threading
import time

import pytest
from studio_jobs import failure, spelled

from flexarm.view.studio.worker import Worker


class Inbox:
    """Received messages of a window, with a method that waits for one."""

    def __init__(self):
        self.parts, self.change = [], threading.Condition()

    def __call__(self, number, part):
        with self.change:
            self.parts.append((number, part))
            self.change.notify_all()

    def wait_for(self, *wanted):
        with self.change:
            found = self.change.wait_for(lambda: wanted in self.parts, timeout=120)
        assert found, (wanted, self.parts)


@pytest.fixture(scope="module")
def shared():
    worker = Worker(spelled, failure, patience=0.2, longest=1.0)
    yield worker
    worker.close()


def test_parts_arrive_in_order_with_the_number_of_their_request(shared):
    inbox = Inbox()
    first = shared.submit("window", "ab", inbox)
    inbox.wait_for(first, "b")
    second = shared.submit("window", "c", inbox)
    inbox.wait_for(second, "c")
    assert second > first
    assert inbox.parts == [(first, "a"), (first, "b"), (second, "c")]


def test_newest_request_of_a_window_replaces_the_waiting_one(shared):
    inbox, other = Inbox(), Inbox()
    shared.submit("window", "sleep 0.1", inbox)
    numbers = [shared.submit("window", f"{k}", inbox) for k in range(10)]
    beside = shared.submit("other", "y", other)
    other.wait_for(beside, "y")  # requests of another window are computed too
    inbox.wait_for(numbers[-1], "9")
    kept = [part for _, part in inbox.parts if part.isdigit()]
    assert kept[-1] == "9"
    assert len(kept) <= 2  # the first may have been taken before the others were submitted


def test_superseded_run_is_stopped_and_the_next_one_computed(shared):
    inbox = Inbox()
    long = shared.submit("window", "sleep 0.9", inbox)
    before = shared._process
    last = shared.submit("window", "z", inbox)
    inbox.wait_for(last, "z")
    assert (long, "s") not in inbox.parts or before is shared._process


def test_request_is_stopped_by_a_more_important_one_but_does_not_stop_it(shared):
    inbox, beside = Inbox(), Inbox()
    long = shared.submit("margins", "sleep 0.9", beside, after="window")
    before = shared._process
    while shared._waiting:  # until it runs
        time.sleep(0.01)
    last = shared.submit("window", "sleep 0.5", inbox)
    shared.submit("margins", "m", beside, after="window")
    inbox.wait_for(last, "p")
    assert (long, "s") not in beside.parts or before is shared._process
    assert inbox.parts == [(last, part) for part in "sleep"]


def test_run_that_takes_too_long_is_stopped_with_a_message(shared):
    inbox = Inbox()
    number = shared.submit("window", "sleep 1e6", inbox)
    with inbox.change:
        assert inbox.change.wait_for(lambda: inbox.parts, timeout=120)
    assert inbox.parts[0][0] == number
    assert "took longer than 1 s" in inbox.parts[0][1]


def test_lost_process_is_reported_and_replaced(shared):
    inbox = Inbox()
    number = shared.submit("window", "exit", inbox)
    with inbox.change:
        assert inbox.change.wait_for(lambda: inbox.parts, timeout=120)
    assert inbox.parts == [(number, inbox.parts[0][1])]
    assert "ended unexpectedly" in inbox.parts[0][1]
    again = shared.submit("window", "b", inbox)
    inbox.wait_for(again, "b")


def test_request_of_a_closed_window_is_dropped(shared):
    inbox, other = Inbox(), Inbox()
    shared.submit("window", "sleep 0.1", other)
    shared.submit("gone", "never", inbox)
    shared.forget("gone")
    last = shared.submit("window", "b", other)
    other.wait_for(last, "b")
    assert inbox.parts == []


def test_closing_ends_the_process():
    worker = Worker(spelled, failure)
    inbox = Inbox()
    worker.submit("window", "sleep 1e6", inbox)
    worker.close()
    assert worker._process is None
    assert inbox.parts == []
