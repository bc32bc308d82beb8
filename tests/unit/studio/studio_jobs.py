"""Jobs for the worker, which imports them by their module in a separate process."""

from __future__ import annotations

import os
import time


def spelled(text):
    """Yield the letters; sleep, fail or exit on request."""
    word, _, seconds = text.partition(" ")
    if word == "sleep":
        time.sleep(float(seconds))
    if word == "exit":
        os._exit(3)
    yield from word


def failure(text):
    return f"failure: {text}"
