"""Packets of other programs and of earlier runs, sent to both sides of a run over UDP."""

import socket
import struct
import threading

import numpy as np


def udp_socket():
    return socket.socket(socket.AF_INET, socket.SOCK_DGRAM)


def place(at):
    host, port = at.split(":")
    return host, int(port)


def packed(*numbers):
    return struct.pack(f"<{len(numbers)}d", *numbers)


#: Bytes that no program of this run sends: noise, packets without a token, an end and a sample of
#: an earlier run, and the request of a plant that has gone.
STALE = [
    b"",
    b"hello",
    bytes(range(256)) * 4,
    packed(-1.0, 0.0),
    packed(0.0, 0.0, 1.0, 2.0, 3.0, 4.0),
    packed(987654321.0, -1.0, 0.0),
    packed(987654321.0, 0.0, 0.0, *np.ones(40)),
    packed(987654321.0, -2.0, 0.0),
    packed(np.nan, -2.0, 0.0, np.nan),
    packed(np.inf, np.nan, -np.inf),
]


def send_stale(at, times=1):
    """Send all of them to an address."""
    with udp_socket() as one:
        for data in times * STALE:
            one.sendto(data, place(at))


class Sender(threading.Thread):
    """Sends them again and again until it is stopped."""

    def __init__(self, at):
        super().__init__(daemon=True)
        self.at, self.over = at, threading.Event()
        self.start()

    def run(self):
        while not self.over.wait(0.002):
            send_stale(self.at)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.over.set()
        self.join()


class Hostile(threading.Thread):
    """Relay between plant and controller that adds packets in both directions.

    Before and after each packet it sends stale ones, repeated ones, and copies with another token,
    number or time.

    Args:
        lost: numbers of the packets that are lost at the start, to and from the controller.
    """

    def __init__(self, to, seed, lost=(0, 0)):
        super().__init__(daemon=True)
        self.inside, self.outside = udp_socket(), udp_socket()
        for one in (self.inside, self.outside):
            one.bind(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.outside.getsockname()[1]}"
        self.to, self.plant, self.seed, self.lost = place(to), None, seed, lost
        threading.Thread(target=self.back, daemon=True).start()
        self.start()

    def run(self):
        random = np.random.default_rng(self.seed)
        for data, sender in received(self.outside, self.lost[0]):
            self.plant = sender
            for each in among_others(data, random):
                self.inside.sendto(each, self.to)

    def back(self):
        random = np.random.default_rng(self.seed + 1)
        for data, _ in received(self.inside, self.lost[1]):
            for each in among_others(data, random, answer=True):
                self.outside.sendto(each, self.plant)


def received(one, lost):
    """Yield the datagrams of a socket after the first ones."""
    while True:
        data, sender = one.recvfrom(9999)
        if lost > 0:
            lost -= 1
        else:
            yield data, sender


def among_others(data, random, answer=False):
    """Return a packet among packets to be ignored.

    A plant also ignores answers with another number or time; a controller cannot know them.
    """
    row = np.frombuffer(data, "<f8")
    others = [STALE[k] for k in random.integers(len(STALE), size=2)]
    for place in (0, 1, 2) if answer and row[1] >= 0.0 else (0,):
        changed = row.copy()
        changed[place] += 1.0 if place < 2 else 1e-9
        changed[3:] = 1e3
        others.append(changed.tobytes())
    order = random.permutation(len(others))
    half = len(order) // 2
    return [*(others[k] for k in order[:half]), data, data, *(others[k] for k in order[half:])]
