"""UDP sockets: the addresses of controllers, and datagrams with a time limit."""

from __future__ import annotations

import re
import select
import socket
from contextlib import suppress
from typing import Any, NamedTuple

from flexarm.base.errors import InputError, Problem, shown

#: Longest time (s) for which `select` waits.
_DAY = 86400.0
#: Longest datagram that is read; longer ones are truncated and have a wrong length.
_LONGEST = 65535
_ADDRESS = re.compile(r"([^\s:]+):(\d{1,5})")


class Address(NamedTuple):
    """Host and port at which a controller listens."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"{self.host}:{self.port}"


def check_address(name: str, value: object) -> Address:
    """Return the address of a text such as ``"127.0.0.1:5005"``.

    Raises:
        InputError: if the text is not a host and a port, or the host has no address.
    """
    found = _ADDRESS.fullmatch(value) if isinstance(value, str) else None
    if found is None or not 0 < int(found[2]) < 65536:
        rule = "be an object or an address such as '127.0.0.1:5005'"
        raise InputError(Problem(name, rule, shown(value)))
    try:
        return Address(socket.gethostbyname(found[1]), int(found[2]))
    except OSError:
        raise InputError(Problem(name, "contain a known host", shown(value))) from None


class Datagrams:
    """Datagrams to and from a partner.

    Args:
        address: of the partner; with ``listen``, of this side, whose datagrams go to the last
            sender until `hold` is called.

    Raises:
        InputError: if this side cannot listen at the address.
    """

    def __init__(self, address: Address, listen: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._listens = listen
        self._partner: tuple[Any, ...] | None = None
        try:
            (self._socket.bind if listen else self._socket.connect)(address)
        except OSError as error:
            self._socket.close()
            what = "listen" if listen else "send"
            rule = f"be an address at which this computer can {what} ({error.strerror})"
            raise InputError(
                Problem("plant" if listen else "controller", rule, str(address))
            ) from None

    def send(self, data: bytes) -> None:
        """Send a datagram; one that cannot be delivered is lost."""
        with suppress(OSError):
            if self._partner is None:
                self._socket.send(data)
            else:
                self._socket.sendto(data, self._partner)

    def hold(self) -> None:
        """Exchange datagrams with the last sender alone."""
        assert self._partner is not None
        self._socket.connect(self._partner)
        self._listens, self._partner = False, None

    def receive(self, seconds: float) -> bytes | None:
        """Return the next datagram, or None if there is none within a time, s, or one was lost."""
        # `select` waits for microseconds; the time limit of a socket is in milliseconds.
        ready, _, _ = select.select([self._socket], [], [], min(max(seconds, 0.0), _DAY))
        if not ready:
            return None
        try:
            data, sender = self._socket.recvfrom(_LONGEST)
        except OSError:  # a datagram sent before was refused: the partner does not listen
            return None
        if self._listens:
            self._partner = sender
        return data

    def close(self) -> None:
        """Release the address."""
        self._socket.close()
