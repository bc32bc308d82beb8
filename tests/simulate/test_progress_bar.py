"""The progress bar appears for long runs on a terminal only."""

from __future__ import annotations

import pytest

from flexarm.simulation.run import progress as meter


@pytest.fixture
def clock(monkeypatch):
    class Clock:
        now = 0.0

    monkeypatch.setattr(meter.time, "perf_counter", lambda: Clock.now)
    return Clock


@pytest.fixture
def screen(monkeypatch, capsys):
    monkeypatch.setenv("TERM", "xterm")
    return lambda: capsys.readouterr().err


def run(shown, clock, seconds):
    with meter.Meter("simulating", shown) as bar:
        for k in range(11):
            clock.now = seconds * k / 10
            bar.update(k / 10)


def test_bar_appears_after_a_second(clock, screen):
    run(True, clock, 5.0)
    assert "simulating" in screen()


def test_bar_does_not_appear_before(clock, screen):
    run(True, clock, 0.9)
    assert screen() == ""


@pytest.mark.parametrize("shown", [False, None])
def test_bar_is_omitted_without_request_or_terminal(shown, clock, screen):
    run(shown, clock, 5.0)
    assert screen() == ""


def test_long_tasks_write_lines_to_other_streams(clock, screen):
    with meter.Meter("simulating", None, lines=True) as bar:
        for k in range(1, 101):
            clock.now = float(k)
            bar.update(k / 100)
    lines = screen().splitlines()
    assert lines[0] == "simulating: 11 %, 89 s left"
    assert 16 <= len(lines) <= 18  # each 5 % from there on, or 6 % by rounding


@pytest.mark.parametrize("shown", [False, True])
def test_lines_are_omitted_on_request(shown, clock, screen):
    with meter.Meter("simulating", shown, lines=True) as bar:
        clock.now = 60.0
        bar.update(0.5)
    assert "s left" not in screen()


def test_bar_appears_on_a_terminal_by_default(clock, screen, monkeypatch):
    monkeypatch.setattr(meter.sys.stderr, "isatty", lambda: True, raising=False)
    run(None, clock, 5.0)
    assert "simulating" in screen()
