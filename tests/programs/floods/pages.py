"""Loads of the browser client at a fixed rate, from one address.

A load is the page and then its script, each from a new connection, as browsers with an empty cache
ask for them. Loads begin on time, whether or not earlier ones have been answered.
"""

from __future__ import annotations

import errno
import selectors
import socket
import time

__all__ = ["PageFlood"]

MAX_OPEN = 800
"""Connections at once; loads beyond that are left out."""
CHUNK = 256 * 1024
LOOK_SECONDS = 0.01


class _Load:
    """One load: its present connection, and the requests that are left."""

    def __init__(self, port: int, requests: list[bytes]) -> None:
        self._address = ("127.0.0.1", port)
        self._requests = requests
        self.open()

    def open(self) -> None:
        """Open the connection of the next request."""
        self.socket = socket.socket()
        self.socket.setblocking(False)
        code = self.socket.connect_ex(self._address)
        if code not in (0, errno.EINPROGRESS):
            raise OSError(code, "cannot connect")
        self._unsent = self._requests.pop(0)

    def go_on(self) -> bool:
        """Send the request or read the answer; return False when the answer is complete."""
        if self._unsent:
            self._unsent = self._unsent[self.socket.send(self._unsent) :]
            return True
        return bool(self.socket.recv(CHUNK))

    @property
    def sends(self) -> bool:
        return bool(self._unsent)

    @property
    def is_last(self) -> bool:
        """True if no request is left."""
        return not self._requests


class PageFlood:
    """Loads of the page from one address.

    Args:
        port: The server's port.
        rate: Loads a second.
        paths: The paths that a load requests, one after the other.
    """

    def __init__(self, port: int, rate: float, paths: tuple[str, ...]) -> None:
        self._port, self._rate = port, rate
        self._requests = [
            f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nAccept-Encoding: gzip\r\n\r\n".encode()
            for path in paths
        ]
        self._open = selectors.DefaultSelector()
        self._served = 0

    def run(self) -> None:
        """Flood until the process is killed; print the number of complete loads of each second."""
        begun = reported = time.monotonic()
        offered = 0
        while True:
            now = time.monotonic()
            due = int((now - begun) * self._rate)
            for _ in range(min(due - offered, MAX_OPEN - len(self._open.get_map()))):
                self._watch(_Load(self._port, list(self._requests)))
            offered = due
            for key, _ in self._open.select(LOOK_SECONDS):
                self._go_on(key.data)
            if now - reported >= 1:
                print(self._served, flush=True)
                reported, self._served = now, 0

    def _watch(self, load: _Load) -> None:
        self._open.register(load.socket, selectors.EVENT_WRITE, load)

    def _go_on(self, load: _Load) -> None:
        try:
            if load.go_on():
                if not load.sends:
                    self._open.modify(load.socket, selectors.EVENT_READ, load)
                return
        except BlockingIOError:
            return
        except OSError:
            # The server has closed it before its answer: the load fails.
            self._close(load)
            return
        self._close(load)
        if load.is_last:
            self._served += 1
        else:
            load.open()
            self._watch(load)

    def _close(self, load: _Load) -> None:
        self._open.unregister(load.socket)
        load.socket.close()
